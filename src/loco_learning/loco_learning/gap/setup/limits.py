# SPDX-License-Identifier: Apache-2.0
"""Numbers from which on a set-up counts as wrong; `tests/loco_learning/gap/setup` holds both sides.

Hidden physical effects of the blind battery and shipped measured sets lie on one side of each,
mistakes as users make them on the other.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Limits:
    """Limits of the tests of a set-up.

    Attributes:
        against: Correlation of motion and model, below minus which a sign is wrong.
        follows: Correlation from which on a joint follows a command.
        apart: Correlation by which the command of another joint must be ahead of its own.
        scale: Ratio of motion and model from which on a scale is wrong.
        near: Distance of a ratio from a known one, in log.
        samples: Samples that tell a correlation.
        better: Times that the miss must fall with the line that mends.
        left: Miss that may be left with it, over the deviation of the motion.
        missed: Miss of the model from which on its bodies are suspected.
        worst: Joints whose scale is sought, at most.
        both: Ratio from which on the scale of positions and commands is wrong.
        scales: Ratios that are tried first.
        sections: Steps of the search about the best of them.
        tilted: Angle from which on a base is not where the model has it; less is a slope [rad].
        carried: Times that no weight may miss more than a turned one, which has two numbers to fit.
        rounds: Mistakes of the robot or of whole joints that are sought one after the other.
        jumps: Jumps of one size that are a wrap.
        fastest: Speed of a joint whose URDF has no limit of it [rad/s or m/s].
        turning: Rate of a gyro from which on a bolted base moves [rad/s].
        resting: Rate of a gyro below which a free base rests [rad/s].
        moving: Speed of a joint that would turn a free base [rad/s].
        early: Samples by which a motion must be ahead of its command.
        same: Distance of q from its command over that of the model, below which both are one.
        exact: Correlation of efforts with what a drive asks for that differ by a factor alone.
        needed: The same with what the motion needs, friction left out.
        effort: Ratio from which on an effort is in another unit.
        alike: Times that two ways to mend may differ and cannot be told apart.
    """

    against: float = 0.6
    follows: float = 0.9
    apart: float = 0.4
    scale: float = 1.5
    near: float = 0.12
    samples: int = 20
    better: float = 2.5
    left: float = 0.5
    missed: float = 0.05
    worst: int = 6
    both: float = 1.4
    scales: tuple[float, ...] = (
        *(0.01, 0.03, 0.1, 0.16, 0.25, 0.4, 0.65, 1.0),
        *(1.55, 2.5, 4.0, 6.3, 10.0, 20.0, 57.3, 130.0, 400.0, 1000.0),
    )
    sections: int = 10
    tilted: float = 0.35
    carried: float = 2.0
    rounds: int = 2
    jumps: int = 2
    fastest: float = 30.0
    turning: float = 0.2
    resting: float = 0.01
    moving: float = 0.5
    early: float = 0.5
    same: float = 0.05
    exact: float = 0.99
    needed: float = 0.85
    effort: float = 1.12
    alike: float = 1.3


LIMITS = Limits()
