# SPDX-License-Identifier: Apache-2.0
"""Settings of a fleet, and the processor time of its jobs."""

from __future__ import annotations

from dataclasses import dataclass

from loco_control.params import Params, parameter


@dataclass(frozen=True)
class FleetParams(Params):
    """Effort of a fleet, and what counts as an effect of a robot."""

    seconds: float = parameter(
        10.0, "of a recording, the part that moves most, in which sizes are measured", "s", low=1.0
    )
    search_seconds: float = parameter(
        4.0, "the same in a search, as of the records of the blind battery", "s", low=1.0
    )
    searched: int = parameter(
        4, "recordings of a robot's day, the most informative together, that are searched; the "
        "last is held out", low=1, high=40
    )  # fmt: skip
    rounds: int = parameter(
        2, "searches of a robot: the second on the day that the first does not explain", low=1,
        high=5,
    )  # fmt: skip
    steps: int = parameter(3, "Gauss-Newton steps of the sizes of a recording", low=1, high=10)
    difference: float = parameter(
        0.25, "finite difference of a size, over the size that a search found", "-", 0.01, 1.0
    )
    wide: float = parameter(
        10.0, "standard deviation of a size before its recording is seen, over the size that a "
        "search found: it decides only where a recording says nothing", "-", 1.0
    )  # fmt: skip
    absent: float = parameter(
        0.5, "probability, before the data, that a robot lacks an effect of the fleet", "-", 0.05,
        0.95,
    )  # fmt: skip
    varies: float = parameter(
        0.1, "standard deviation of a size between days, over the size, before it is estimated",
        "-", 0.0, 1.0,
    )  # fmt: skip
    unexplained: float = parameter(
        0.5, "share of a day's recordings with errors that no effect explains above which the day "
        "is searched", "-", 0.0, 1.0
    )  # fmt: skip


@dataclass(frozen=True)
class Costs(Params):
    """Processor time of jobs on an arm of seven joints, for the progress only."""

    reading: float = parameter(0.2, "reading a recording", "s", low=0.0)
    simulation: float = parameter(1.5, "simulating a day's recording", "s", low=0.0)
    search: float = parameter(60.0, "a search", "s", low=0.0)
    measurement: float = parameter(2.0, "the sizes of a recording", "s", low=0.0)


COSTS = Costs()
