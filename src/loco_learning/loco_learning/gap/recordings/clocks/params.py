# SPDX-License-Identifier: Apache-2.0
"""Limits for the clocks of recordings, each with its provenance."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class CutParams:
    """Limits above which a record is divided at a fault of its clock.

    Attributes:
        run: Consecutive readings, with stamps before those of earlier ones, whose path decides
            whether they were delivered late [readings]. Measured on 400 motions up to 3 Hz, read at
            100 Hz with 0 to 10 % noise: 3 late readings are classified as a clock set back in 5 %,
            and the reverse in 12 %; with the test for fewer readings, in 0 % and 49 %.
        misfit: Distance of fewer late readings from the line between the neighbours of their
            stamps, over the 95th percentile of such distances, above which they belong elsewhere.
            Measured on 2,000 such motions: 2 classifies 0.8 % of late readings as a clock set
            back, 3 to 8 none; of clocks set back by 3 periods, 5 misses 26 %.
        late: Largest step back of two exchanged neighbours, over the typical period. Theory: 1,
            and a hundredth for the rounding of stamps.
        silence: Length of a pause, in typical periods. Theory: half a period more than four lost
            readings in a row, which linear interpolation can still replace.
        pause: Shortest pause [s] of angles and commands together that divides a record. Taste: the
            model would hold the last command during it; a drive responds within about this time.
        around: Readings on each side of a shorter gap whose parabola decides whether the clock was
            set forward there [readings]. Taste: twice as many as the parabola has coefficients.
        continues: Their distance from the parabola without the gap, over the 95th percentile of
            such distances, below which the motion goes on; with the gap it is above `misfit`.
            Measured on motions of 1 to 6 joints at 100 to 500 Hz: none of 960 losses of readings is
            classified as a clock set forward; 341 of 480 of those are found in sines up to 3 Hz and
            94 of 480 in joints that mostly rest, nearly none with 1 % noise.
    """

    run: int = 3
    misfit: float = 5.0
    late: float = 1.01
    silence: float = 4.5
    pause: float = 0.1
    around: int = 4
    continues: float = 1.5


@dataclass(frozen=True)
class LineParams:
    """Limits for arrival time stamps to be treated as those of an even clock.

    Attributes:
        fewest: Smallest number of readings of a clock [readings]. Taste: five in each part.
        parts: Parts of a record that must each have a reading without delay. Taste.
        on_line: Largest delay of the earliest reading of a part, in periods, for it to be on the
            line. Taste: a quarter, since a lost reading causes a whole period.
        even: Largest delay of all readings, in periods, that needs no correction. Taste: its
            effect on a signal is a hundredth of the change in a period.
        sure: Standard errors of a significant difference. Theory: 3 in 1,000 by chance.
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
    """Limits for the readings of one signal to be treated as two series.

    Attributes:
        apart: Distance between the series over the range of the signal. Taste: closer ones cross
            all the time and change little.
        steps: Distance between the series over the smallest step of the signal. Theory: noise of
            a third of a step makes two values of one, of a whole step four or five.
        shorter: Path between the series over that within both; distance of one value from a
            motion over its curvature. Measured at 100 Hz: of 700 signals with noise of three
            colours, rounding and rests one reaches it; of one value between readings of motions
            up to 6 Hz all 485 do, of two motions up to 1 Hz 99 %, up to 3 Hz 64 %.
        changes: Smallest number of changes between the series [changes]. Taste: fewer are faults.
        own: Ratio of the measured velocity to that of the changes, above which the joint itself
            moves. Theory: a sine of half the sampling rate has pi/2 at its mean position, 0 at its
            reversals; two publishers each move far slower than the changes between them.
        spikes: Share of the readings of one value from which the motion before and after must jump
            back. Theory: all of a second publisher's, but those at which the motion crosses the
            value; of a motion through the value, none.
        rough: Change of the second motion from one of its steps to the next, over its steps.
            Theory: 1.4 for a sine of four readings a period, 1.7 for values that have no order.
    """

    apart: float = 0.02
    steps: float = 5.0
    shorter: float = 6.0
    changes: int = 10
    own: float = 0.5
    spikes: float = 0.5
    rough: float = 1.4


@dataclass(frozen=True)
class SlowParams:
    """When a log keeps but some of the commands, and how it is trusted between them.

    Attributes:
        ratio: Rate of commands over that of the log, from which on some are missing. Theory: 2
            where every second is; less than halfway to it is a clock that is a little off.
        samples: Values of a command of which one in four still makes a curve [values]. Theory: six
            for a spline of degree 5.
        close: Distance of two values, over the median one, at which the second is left out: a slope
            between them is that of their noise (taste).
        degrees: Degrees of the curves that are tried between values: 3 is a local cubic, 5 a
            spline. Theory: errors fall with the distance of values to the power of degree + 1.
        shared: Share of the time stamps of a command, or of a position if it has fewer, that both
            have if they are logged in the same rows. Taste: one row in ten may lack a value.
    """

    ratio: float = 1.5
    samples: int = 24
    close: float = 0.1
    degrees: tuple[int, ...] = (3, 5)
    shared: float = 0.9


@dataclass(frozen=True)
class TickParams:
    """Limits for moving signals from their own time stamps to the even times of a record.

    Attributes:
        even: Distance from the closest time up to which a stamp is on it [periods]. Taste: the
            change of a signal within it is far below its noise.
        smooth: Roles whose readings are moved along the signal; others may jump. Theory:
            positions have no jumps, velocities only at contacts.
        around: Readings before and after one whose cubic tells how the signal changes about it
            [readings]. Theory: noise of this change at half a period is a third of that of the
            reading, and a motion of 20 readings a period is off by 10^-5 of its amplitude.
        sparse: Periods of the axis per reading from which on a signal is not interpolated. Taste.
        whole: Largest difference of these periods from a whole number, as a share of it, for
            readings to be moved to evenly spaced times. Taste.
        mostly: Share of times with a reading of their own above which the other times lost
            theirs. Theory: a half, as with two times per reading.
        dropped: Rms distance of the times between readings from whole numbers of periods, in
            periods, up to which the longer ones are those of dropped readings. Theory: half of
            that of times of any length, 0.29.
    """

    even: float = 1e-3
    smooth: tuple[str, ...] = ("q", "dq")
    around: int = 3
    sparse: float = 1.5
    whole: float = 0.05
    mostly: float = 0.5
    dropped: float = 0.144


@dataclass(frozen=True)
class StaleParams:
    """Limits above which rows of a log repeat readings of a slower rate.

    Attributes:
        fewest: Smallest number of readings [readings]. Taste.
        uneven: Distance of the rows between two readings from the usual number, over it, above
            which they are uneven. Taste: a reading is a row early or late where the rates are no
            multiples of each other.
        rare: Share of uneven distances, above which signals rest or are coarse. Taste.
        varies: Deviation of the steps of a signal, over their mean, above which they are those of
            a motion. Theory: 0 of an encoder that moves by one step at a time.
    """

    fewest: int = 20
    uneven: float = 0.5
    rare: float = 0.02
    varies: float = 0.2


CUTS, LINES, SERIES, RATES, TICKS, STALE = (
    CutParams(), LineParams(), SeriesParams(), SlowParams(), TickParams(), StaleParams()
)  # fmt: skip
