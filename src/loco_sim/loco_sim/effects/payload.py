# SPDX-License-Identifier: Apache-2.0
"""A mass carried by the robot."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from loco_control.exceptions import ParameterError
from loco_control.params import parameter

from .base import Effect

if TYPE_CHECKING:
    from ..world import World


@dataclass
class Payload(Effect, name="payload"):
    """A point mass fixed to a link from the beginning to the end.

    It becomes part of the link's mass, centre of mass and inertia
    (`description.add_point_mass`), which the engine cannot change in mid-run.
    """

    mass: float = parameter(0.0, "mass of the payload", "kg", low=0.0)
    position: tuple[float, float, float] = parameter((0.0, 0.0, 0.0), "where, link frame", "m")
    link: str = parameter("", "link that carries it; empty is the base")

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.start > 0.0 or self.stop != float("inf"):
            raise ParameterError(
                f"effect payload is there from start to end: start {self.start:g} s and "
                f"stop {self.stop:g} s are not possible, only 0 and .inf"
            )

    def configure(self, world: World) -> None:
        if self.mass > 0.0:
            link = self.link or world.description.root_link()
            world.description.add_mass(link, self.mass, self.position)
