# SPDX-License-Identifier: Apache-2.0
"""Parameters of the third learning step, with the reason for each default.

A default is from *theory*, a matter of *taste*, or from the *battery*: trials with the
bound of Tigrillo, two seeds each; their results are on the page `docs/reinforce.md`.
"""

from __future__ import annotations

from dataclasses import dataclass

from loco_control.exceptions import ParameterError
from loco_control.params import Params, parameter


@dataclass(frozen=True)
class RewardParams(Params):
    """Prices of a tick: speed is earned, power is paid for, and so is a fall.

    The reward of a tick is v / v0 - cost P / (m g v0), v being the speed of the base along its
    own x axis, P the positive power of the drives and v0 the `speed` that earns 1. Walking at v0
    with a cost of transport C earns 1 - cost C in each tick.
    """

    speed: float = parameter(0.25, "speed that earns 1 (battery: the shipped bound)", "m/s", 1e-3)
    cost: float = parameter(0.3, "price of a cost of transport of 1 (taste)", "-", 0.0, 1e3)
    fall: float = parameter(
        1.0, "price of a fall, in whole episodes at a reward of 1 (taste)", "-", 0.0, 1e3
    )


@dataclass(frozen=True)
class ReinforceParams(Params):
    """Settings of the policy gradient, and the episodes that it learns from."""

    seed: int = parameter(0, "seed of perturbations, sensors, pushes and bodies", "-", 0, 2**31 - 1)
    seconds: float = parameter(600.0, "budget of simulated time (taste)", "s", 0.1, 1e7)
    lead: float = parameter(
        1.5, "the target drives so long before the readout does (battery: the gait is there)",
        "s", 0.0, 1e3,
    )  # fmt: skip
    episode: float = parameter(
        5.0, "the readout drives so long (battery: strides average sensor noise to 1 %)",
        "s", 0.1, 1e4,
    )  # fmt: skip
    batch: int = parameter(
        12, "perturbed episodes per update, half of them mirrored (battery)", "-", 2, 10000
    )
    exploration: float = parameter(
        0.03, "sigma, rms of what a perturbation adds to a joint (battery)", "rad", 1e-6, 10.0
    )
    directions: int = parameter(
        6, "leading directions of the hidden activity that are explored (battery: they hold 95 % "
        "of it)", "-", 1, 5000,
    )  # fmt: skip
    step: float = parameter(1.0, "learning rate, in sigmas (battery)", "-", 0.0, 1e3)
    momentum: float = parameter(
        0.7, "share of the last gradient that goes on (battery)", "-", 0.0, 0.999
    )
    discount: float = parameter(
        1.0, "gamma of eq. (3.18) per tick (theory: episodes are short, nothing is discounted)",
        "-", 0.0, 1.0,
    )  # fmt: skip
    push: float = parameter(
        0.0, "random pushes on the base while it learns, as a share of the weight", "-", 0.0, 100.0
    )
    randomise: float = parameter(
        0.0, "spread of stiffness, friction and masses while it learns, relative", "-", 0.0, 1.0
    )
    reward: RewardParams = parameter(RewardParams(), "prices of a tick")

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.batch % 2:
            raise ParameterError(
                f"batch must be even, for every perturbation is tried with its mirror image; "
                f"got {self.batch}, take {self.batch + 1}"
            )
