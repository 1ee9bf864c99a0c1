# SPDX-License-Identifier: Apache-2.0
"""Limits for the clocks of recordings, each with its provenance."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class CutParams:
    """Limits from which on a record is cut at a fault of its clock.

    Attributes:
        run: Readings in a row, behind those before them, whose path tells whether they were
            delivered late [readings]. Measured on 400 motions up to 3 Hz, read at 100 Hz with 0 to
            10 % noise: 3 late readings are taken for a clock set back in 5 %, and the other way
            round in 12 %; with the test of fewer, in 0 % and 49 %.
        misfit: Distance of fewer late readings from the line between the neighbours that their
            stamps give them, over the 95th percentile of such distances, from which on they belong
            elsewhere. Measured on 2,000 such motions: 2 takes 0.8 % of late readings for a clock
            set back, 3 to 8 none; of clocks set back by 3 periods, 5 misses 26 %.
        late: Step back over the usual period up to which two neighbours were exchanged. Theory: 1,
            and a hundredth for the rounding of stamps.
        silence: Usual periods without a reading that are a pause. Theory: half a period more than
            four readings lost in a row, of which straight lines still tell.
        pause: Shortest pause [s] of angles and commands together that cuts a record. Taste: the
            model would hold the last command through it; a drive follows within about as long.
    """

    run: int = 3
    misfit: float = 5.0
    late: float = 1.01
    silence: float = 4.5
    pause: float = 0.1


@dataclass(frozen=True)
class LineParams:
    """Limits from which on stamps of arrival count as those of an even clock.

    Attributes:
        fewest: Readings of a clock [readings]. Taste: five in each part.
        parts: Parts of a record that each have a reading which came at once. Taste.
        on_line: Lateness of the earliest reading of a part, in periods, that is still on the line.
            Taste: a quarter, so that a lost reading, which makes a whole one, is none.
        even: Lateness of all readings, in periods, that needs no other clock. Taste: what it does
            to a signal is a hundredth of its change in a period.
        sure: Standard errors that are no chance. Theory: 3 in 1,000 by chance.
        rounding: Rounding of stamps [s]. Theory: stamps of ROS have whole nanoseconds.
    """

    fewest: int = 40
    parts: int = 8
    on_line: float = 0.25
    even: float = 0.01
    sure: float = 3.0
    rounding: float = 1e-9


@dataclass(frozen=True)
class SeriesParams:
    """Limits from which on readings of one signal count as two series.

    Attributes:
        apart: Distance between the series over the range of the signal. Taste: nearer ones cross
            all the time and change little.
        steps: Distance between the series over the smallest step of the signal. Theory: noise of
            a third of a step makes two values of one, of a whole step four or five.
        shorter: Path at changes of the series over what it is within both, and distance of one
            value from a motion over what that bends. Measured at 100 Hz: of 700 signals with noise
            of three colours, rounding and rests one reaches it; of one value between readings of
            motions up to 6 Hz all 485 do, of two motions up to 1 Hz 99 %, up to 3 Hz 64 %.
        changes: Changes from one series to the other [changes]. Taste: fewer are single faults.
        own: Measured velocity over what the changes take, from which on they are the joint's own.
            Theory: a sine of half the sampling rate has pi/2 times that at its mean place, 0 at
            its turns; of two publishers each moves far slower than the ways between them.
    """

    apart: float = 0.02
    steps: float = 5.0
    shorter: float = 6.0
    changes: int = 10
    own: float = 0.5


CUTS, LINES, SERIES = CutParams(), LineParams(), SeriesParams()
