# SPDX-License-Identifier: Apache-2.0
"""Detection of feet and wheels: the ends of limbs that reach lowest."""

from __future__ import annotations

import re
import xml.etree.ElementTree as ET
from collections import Counter
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from ..foreign.shapes import link_points
from ..geometry import Triple, rotate, rotation_matrix
from ..params import SimParams
from ..robot.description import TENSOR, Description
from ..robot.robot import Robot
from ..world.world import World, make_world
from .body import BASE, Body

UNIT = {"ixx": "1", "iyy": "1", "izz": "1"}  # inertia given to massless links [kg·m²]
ALOFT = 100.0  # base height for trying poses without ground contact [m]
SAMPLES = 400  # number of random poses for the depth that each end reaches
SAME_DEPTH = 0.12  # tolerance to the deepest end within which ends are supports, share of its depth
ROUND = 0.03  # height variation of a turning wheel's lowest point, share of its radius
LEVEL = 0.02  # points this close to the lowest one touch the ground, share of the size


@dataclass(frozen=True)
class Support:
    """A foot or wheel that a robot stands on.

    Attributes:
        body: Body that touches the ground.
        link: Link of that body with the lowest point.
        chain: Joints that move this end and no other, from the base outwards.
        wheel: Whether it is a wheel, whose joint is the last of the chain.
        depth: Largest reach below the base [m], positive.
    """

    body: int
    link: str
    chain: tuple[int, ...]
    wheel: bool
    depth: float


@dataclass
class Probe:
    """A robot in the engine, used to compute link positions at given poses.

    Attributes:
        body: Tree of the robot.
        world: The engine.
        points: Corners of the shapes of each body, in its frame [m], (k, 3).
        up: Orientation of the base, x y z w.
    """

    body: Body
    world: World
    points: dict[int, np.ndarray]
    up: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 1.0)
    _index: dict[str, int] = field(default_factory=dict, repr=False)

    def __post_init__(self) -> None:
        self._index = {link: k for k, links in self.body.links.items() for link in links}

    def lowest(self, q: np.ndarray) -> dict[str, Triple]:
        """Lowest point of each collision link relative to the base's origin, world axes [m]."""
        self.world.pose((0.0, 0.0, ALOFT), self.up, q)
        return {link: (x, y, z - ALOFT) for link, (x, y, z) in self.world.lowest_points().items()}

    def by_body(self, q: np.ndarray) -> dict[int, tuple[Triple, str]]:
        """Lowest point of each body with collision shapes [m], and its link."""
        lowest: dict[int, tuple[Triple, str]] = {}
        for link, point in self.lowest(q).items():
            k = self._index[link]
            if k not in lowest or point[2] < lowest[k][0][2]:
                lowest[k] = point, link
        return lowest

    def size(self, q: np.ndarray) -> float:
        """Longest side of the box around the shapes of the robot [m]."""
        turn, place = self.body.forward(q)
        rows = [place[k] + points @ turn[k].T for k, points in self.points.items()]
        corners = np.vstack([*rows, place])
        return max(1e-3, float(np.ptp(corners, axis=0).max()))


@contextmanager
def probe(urdf: str, folder: Path) -> Iterator[Probe]:
    """Context of a robot from a URDF in a separate engine, for kinematics only."""
    description = Description(urdf)
    body = Body(description)
    elements = {link.get("name"): link for link in description.elements("link")}
    points = {k: _points(body, k, elements, folder) for k in body.links}
    model = _with_masses(urdf)
    robot = Robot("new", model, folder, body.joints, (), np.zeros(len(body.joints)), np.array([]))
    world = make_world(robot, SimParams(), 0.001)
    try:
        world.rebuild(body.nominal(), height=ALOFT)
        yield Probe(body, world, points)
    finally:
        world.close()


def _with_masses(urdf: str) -> str:
    """URDF with a mass on every link, as MuJoCo requires; poses do not depend on it."""
    description = Description(urdf)
    for link in description.elements("link"):
        if description.mass_of(link.get("name", "")) == 0.0:
            for inertial in link.findall("inertial"):
                link.remove(inertial)
            inertial = ET.SubElement(link, "inertial")
            ET.SubElement(inertial, "mass", value="1")
            ET.SubElement(inertial, "inertia", {**dict.fromkeys(TENSOR, "0"), **UNIT})
    return description.text()


def _points(body: Body, k: int, elements: dict, folder: Path) -> np.ndarray:
    parts = [np.zeros((0, 3))]
    for name in body.links[k]:
        frame = body.frame(name)
        parts.append(frame.place + link_points(elements[name], folder) @ frame.turn.T)
    return np.concatenate(parts)


def supports(probe: Probe, q: np.ndarray, rng: np.random.Generator) -> list[Support]:
    """Feet and wheels of a robot; none if nothing reaches below its base.

    Args:
        probe: The robot.
        q: Initial joint positions, (n,).
        rng: Random generator of poses.
    """
    body = probe.body
    chains = {end: _exclusive_joints(body, end) for end in body.leaf_bodies()}
    dofs = sorted({j for chain in chains.values() for j in chain})
    if not dofs:
        return []
    lowest = probe.by_body(q)
    rest = [point[2] for k, (point, _) in lowest.items() if k not in dofs]
    floor = min(rest, default=0.0)
    low = np.where(np.isfinite(body.low), body.low, -np.pi)[dofs]
    high = np.where(np.isfinite(body.high), body.high, np.pi)[dofs]
    reach = {end: (np.inf, "") for end in chains}
    for k in range(SAMPLES):
        pose = q.copy()
        pose[dofs] = q[dofs] if k == 0 else low + (high - low) * rng.random(len(dofs))
        for end, (point, link) in probe.by_body(pose).items():
            if end in reach and point[2] < reach[end][0]:
                reach[end] = point[2], link
    size = probe.size(q)
    deep = {end: z for end, (z, _) in reach.items() if z < floor - LEVEL * size}
    if not deep:
        return []
    return [
        Support(e, reach[e][1], chains[e], _is_wheel(probe, q, e), -reach[e][0])
        for e in _deepest(body, deep, min(floor, 0.0))
    ]


def _deepest(body: Body, deep: dict[int, float], floor: float) -> list[int]:
    """Ends that reach about as deep as the deepest one, except arms.

    An arm is the only limb that reaches deeper than all others, or the only one of three or more
    limbs that differs from the others.

    Args:
        body: The robot.
        deep: Depth of each end below the base [m], negative.
        floor: Height of the lowest fixed part [m], at most 0.
    """
    limb, rest = {end: body.path(end)[0] for end in deep}, dict(deep)
    while True:
        limit = min(rest.values()) + SAME_DEPTH * abs(min(rest.values()) - floor)
        selected = [end for end in rest if rest[end] <= limit]
        shallower = {e: z for e, z in rest.items() if limb[e] not in {limb[c] for c in selected}}
        if len({limb[end] for end in selected}) > 1 or len({limb[end] for end in shallower}) < 2:
            break
        rest = shallower
    (joints, count), *_ = Counter(len(body.path(end)) for end in selected).most_common()
    similar = [end for end in selected if len(body.path(end)) == joints]
    different = {limb[end] for end in selected} - {limb[end] for end in similar}
    return similar if count >= 3 and len(different) == 1 else selected


def _exclusive_joints(body: Body, end: int) -> tuple[int, ...]:
    """Joints that move only the given end."""
    shared = {j for e in body.leaf_bodies() if e != end for j in body.path(e)}
    return tuple(j for j in body.path(end) if j not in shared)


def _is_wheel(probe: Probe, q: np.ndarray, end: int) -> bool:
    body = probe.body
    if np.isfinite(body.high[end]) or body.slides[end]:
        return False
    pose, heights = q.copy(), []
    for angle in np.linspace(0.0, 2.0 * np.pi, 16, endpoint=False):
        pose[end] = q[end] + angle
        lowest = probe.by_body(pose)
        if end not in lowest:
            return False
        heights.append(lowest[end][0][2])
    turn, place = body.forward(q)
    axis = body.axes(turn)[end]
    before = place[end][2] - np.mean(heights)
    return abs(axis[2]) < 0.7 and np.ptp(heights) < 2.0 * ROUND * abs(before)


def stands_at(probe: Probe, q: np.ndarray) -> bool:
    """Whether the lowest points at q are at least two limb ends, around the centre of mass."""
    lowest = probe.by_body(q)
    if not lowest:
        return False
    size, limb_ends = probe.size(q), set(probe.body.leaf_bodies())
    bottom = min(point[2] for point, _ in lowest.values())
    touching = {k: p for k, (p, _) in lowest.items() if p[2] < bottom + LEVEL * size}
    if len(touching) < 2 or not set(touching) <= limb_ends or BASE in touching:
        return False
    points = np.array(list(touching.values()))[:, :2]
    com = np.array(rotate(rotation_matrix(probe.up), probe.body.centre(q)))[:2]
    margin = 0.1 * size
    return bool(
        np.all(com > points.min(axis=0) - margin) and np.all(com < points.max(axis=0) + margin)
    )


SIDES = {
    **dict.fromkeys(("fl", "lf"), (1, 1)), **dict.fromkeys(("fr", "rf"), (1, -1)),
    **dict.fromkeys(("hl", "lh", "rl", "bl", "lb"), (-1, 1)),
    **dict.fromkeys(("hr", "rh", "rr", "br", "rb"), (-1, -1)),
}  # fmt: skip


def side_of(name: str) -> tuple[int, int]:
    """Position of a limb by its name: front 1 or hind -1, left 1 or right -1; 0 if not named."""
    tokens = re.findall(r"[a-z]+", re.sub(r"(?<=[a-z])(?=[A-Z])", " ", name).lower())
    for token in tokens:
        if token in SIDES:
            return SIDES[token]
    text = " ".join(tokens)
    front = 1 if "front" in text or "fore" in text else 0
    hind = 1 if any(w in text for w in ("back", "hind", "rear")) else 0
    left, right = "left" in text, "right" in text
    return front - hind, int(left) - int(right)
