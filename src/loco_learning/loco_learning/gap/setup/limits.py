# SPDX-License-Identifier: Apache-2.0
"""Limits above which a set-up counts as wrong; `tests/loco_learning/gap/setup` tests both sides.

Hidden physical effects of the blind battery and shipped measured data lie on one side of each
limit, typical mistakes of users on the other.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class Limits:
    """Limits of the tests of a set-up.

    Attributes:
        against: Negative correlation of motion and model above which a sign is wrong.
        follows: Correlation above which a joint follows a command.
        apart: Smallest lead of another joint's command in correlation over the joint's own.
        scale: Ratio of motion and model above which a scale is wrong.
        near: Largest distance of a ratio to a known one [log].
        samples: Smallest number of samples for a correlation.
        better: Smallest factor by which a correction must lower the error.
        left: Largest error with the correction, over the deviation of the motion.
        missed: Error of the model above which its bodies are suspected.
        worst: Largest number of joints whose scale is tested.
        both: Ratio above which the common scale of positions and commands is wrong.
        scales: Ratios of the initial grid search.
        weaker: Ratios of a limit of a drive to the torque that it asks for, before a finer search.
        about: Factors on a scale at which it must explain less.
        sections: Steps of the golden-section search about the best of them.
        tilted: Angle above which a motion tells that a base is mounted wrongly [rad]; torques tell
            it from the priors of a slope on (`EFFECTS`), and `doubt`.
        zero: Least offset of an angle that is another zero [rad]. Theory: a centre of mass moved
            sideways by 0.84 of its distance to the axis has its weight at 0.7 rad.
        finer: Distance to each side over which a wrong angle is searched in sections [rad] (taste).
        carried: Largest error of zero gravity over that of rotated gravity, which has two
            parameters.
        rounds: Largest number of mistakes of the robot or of whole joints that are found in turn.
        jumps: Smallest number of jumps of equal size that are a wrap.
        fastest: Velocity limit of a joint without one in the URDF [rad/s or m/s].
        turning: Gyro rate above which a fixed base moves [rad/s].
        resting: Gyro rate below which a free base rests [rad/s].
        moving: Velocity of a joint that would rotate a free base [rad/s].
        share: Deviation of a command in a part of a recording over that of all, from which on it
            moves there; and ratio of a motion to its command from which on it follows.
        apart_by: Ratio of scales of two parts of a recording that have different units.
        leap: Step of a position over the usual largest that moves its zero.
        no_torque: Torque over its root mean square below which a drive gives none (taste).
        pause: Shortest time without torques that is told [s] (taste).
        adrift: Mean square of a joint's distance from its command without torques, beyond what its
            velocity explains, over that with them, from which on its drive was off (taste).
        early: Lead of a motion over its command that is impossible [samples].
        common: Largest distance of the delays of two commands that are late by one time, over it.
        soon: Longest delay of a rate after a command that it follows [s] (taste).
        same: Distance of q from its command over that of the model, below which both are the same.
        exact: Correlation of efforts and drive torques that differ by a factor alone.
        effort: Ratio above which an effort is in another unit.
        tiny: Ratio of the torque that inertia and weight need to a measured one that is none of it:
            ten times what a gravity compensation of 90 % leaves.
        explained: Largest error of the torques that a corrected set-up may leave where they decide,
            over the deviation of the torques: of gains that are guessed, and friction.
        varies: Deviation of a torque over its root mean square below which it tells nothing of
            motion: what drives misreport of a constant torque (a measured one by 3 %).
        sure: Smallest gain over its error in a regression.
        seen: Smallest share of the best determined direction of gravity at which another is fitted.
        doubt: Standard errors by which the angle of an inclined base is above that of slopes.
        alike: Largest ratio of the errors of two corrections that cannot be distinguished.
    """

    against: float = 0.6
    follows: float = 0.9
    apart: float = 0.4
    scale: float = 1.5
    near: float = 0.12
    samples: int = 20
    better: float = 2.5
    left: float = 0.5
    missed: float = 0.01
    worst: int = 6
    both: float = 1.4
    scales: tuple[float, ...] = (
        *(0.01, 0.03, 0.1, 0.16, 0.25, 0.4, 0.65, 1.0),
        *(1.55, 2.5, 4.0, 6.3, 10.0, 20.0, 57.3, 130.0, 400.0, 1000.0),
    )
    weaker: tuple[float, ...] = tuple(np.geomspace(0.02, 1.0, 28))
    about: tuple[float, float] = (0.4, 2.5)
    sections: int = 10
    tilted: float = 0.35
    zero: float = 0.7
    finer: float = 0.03
    carried: float = 2.0
    rounds: int = 2
    jumps: int = 2
    fastest: float = 30.0
    turning: float = 0.2
    resting: float = 0.01
    moving: float = 0.5
    share: float = 0.2
    apart_by: float = 3.0
    leap: float = 3.0
    no_torque: float = 0.1
    pause: float = 0.1
    adrift: float = 4.0
    early: float = 0.5
    common: float = 0.25
    soon: float = 0.1
    same: float = 0.05
    exact: float = 0.99
    effort: float = 1.12
    tiny: float = 100.0
    explained: float = 0.8
    varies: float = 0.1
    sure: float = 5.0
    seen: float = 0.03
    doubt: float = 2.0
    alike: float = 1.3


LIMITS = Limits()
