# SPDX-License-Identifier: Apache-2.0
"""Experiments with a network of masses and springs: ``network`` or ``preset`` in YAML."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from loco_control.exceptions import ParameterError
from loco_control.params import Params, from_dict, parameter, to_dict
from loco_sim.msd.network import chain
from loco_sim.msd.params import MsdParams, preset

from ..networks.gait import Gait
from ..networks.reservoir import LoopParams


@dataclass(frozen=True)
class MsdGaitParams(Params):
    """A gait, one value per link in the order of the network; none: 0, the network's stiffness."""

    amplitude: tuple[float, ...] = parameter((), "relative to rest lengths", "-", 0.0, 1.0)
    phase: tuple[float, ...] = parameter((), "phases", "rad")
    stiffness: tuple[float, ...] = parameter((), "of the springs", "N/m", 0.0)
    frequency: float = parameter(1.0, "frequency of all links", "Hz", 0.0, 100.0)


@dataclass(frozen=True)
class NetworkExperiment(Params):
    """Everything that decides a run of a network: body, gait, and how it learns to drive itself."""

    node_set: ClassVar[str] = "msd"

    name: str = parameter("unnamed", "name in logs and reports")
    description: str = parameter("", "purpose of the experiment, free text")
    robot: str = parameter("msd", "kind of robot", choices=("msd",))
    seed: int = parameter(0, "unused: there are no random values", "-", 0, 2**31 - 1)
    control_rate: float = parameter(200.0, "ticks per second, one per step", "Hz", 1.0, 1e6)
    duration: float = parameter(0.0, "simulated time; 0: all phases of the loop", "s", 0.0, 1e6)
    network: MsdParams = parameter(MsdParams(), "the body")
    gait: MsdGaitParams = parameter(MsdGaitParams(), "target of the links")
    loop: LoopParams = parameter(LoopParams(), "filter, readout, mixer")

    def __post_init__(self) -> None:
        super().__post_init__()
        links = chain(self.network).count
        for key in ("amplitude", "phase", "stiffness"):
            count = len(getattr(self.gait, key))
            if count not in (0, links):
                raise ParameterError(
                    f"gait.{key} must have {links} values, one per link, got {count}"
                )
        if abs(self.control_rate * self.network.step - 1.0) > 1e-9:
            raise ParameterError(
                f"control_rate must be one tick per step, {1.0 / self.network.step:g} Hz, "
                f"got {self.control_rate:g}"
            )

    @property
    def dt(self) -> float:
        """Control period and integration step [s]."""
        return 1.0 / self.control_rate

    @property
    def ticks(self) -> int:
        """Steps from start to end."""
        phases = self.loop.train + self.loop.closing + self.loop.test
        return round((self.duration or phases) * self.control_rate)

    def make_gait(self) -> Gait:
        """The gait as arrays."""
        g = _filled(self.network, self.gait)
        return Gait(*(np.array(v) for v in (g.amplitude, g.phase, g.stiffness)), g.frequency)


def from_values(values: Mapping[str, Any], where: str = "") -> NetworkExperiment:
    """Experiment from nested plain values; `preset` names constants that `network` may change."""
    values = dict(values)
    if "preset" in values:
        base = to_dict(preset(str(values.pop("preset"))).params)
        values["network"] = {**base, **(values.get("network") or {})}
    experiment = from_dict(NetworkExperiment, values, where)
    return experiment.replace(gait=_filled(experiment.network, experiment.gait))


def _filled(network: MsdParams, gait: MsdGaitParams) -> MsdGaitParams:
    """The gait with defaults: amplitude and phase 0, the stiffness of the network."""
    links = chain(network).count
    return gait.replace(
        amplitude=gait.amplitude or (0.0,) * links,
        phase=gait.phase or (0.0,) * links,
        stiffness=gait.stiffness or (network.stiffness,) * links,
    )
