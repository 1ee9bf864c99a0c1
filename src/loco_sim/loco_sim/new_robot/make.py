# SPDX-License-Identifier: Apache-2.0
"""Conversion of a URDF to a robot folder: read, guess missing values, test in the engine, write.

result = make(Path("a1.urdf"), Path("a1"))
result.rows      # what was found and what was guessed
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from loco_control.exceptions import MissingFileError, ParameterError

from ..foreign.joints import WORLDS
from ..foreign.tidy import Tidied
from ..geometry import rotation_matrix
from ..robot.clearance import SPACE, clearance, height_above
from ..robot.urdf_check import mass_of, problems
from . import gains as gain
from . import legs, limits, trial
from .body import Body
from .files import Draft, Folder
from .posture import LEVEL, Posture, Search
from .supports import Probe, Support, probe, stands_at, supports

COS45 = 0.5**0.5
UPWARDS = {  # orientation of the base, x y z w, that turns the named axis upwards
    "z": (0.0, 0.0, 0.0, 1.0), "y": (COS45, 0.0, 0.0, COS45), "-y": (-COS45, 0.0, 0.0, COS45),
    "x": (0.0, -COS45, 0.0, COS45), "-x": (0.0, COS45, 0.0, COS45), "-z": (1.0, 0.0, 0.0, 0.0),
}  # fmt: skip
STIFFER = (1.0, 2.0, 4.0, 0.5)  # factors on the stiffness, tried in turn
ARMS = "the gait moves legs alone (to move them, delete `legs` as well)"
STUCK = "no gains make them follow a swing"
SEED = 0  # seed of random draws: the same URDF gives the same robot
SWING = 0.3, 0.05  # largest swing of a hinge [rad] and of a prismatic joint [m]
SHARE = 0.2  # share of its range that a joint swings to each side
POSES = 200  # random poses for the lowest reach of a fixed-base robot


@dataclass
class Result:
    """A new robot folder with a report on its contents.

    Attributes:
        folder: The robot's folder.
        rows: Rows of a table: a property, its value, its origin.
        notes: Sentences about repaired faults and about failed steps.
        stands: Whether the robot stands on its feet; otherwise the base is fixed and joints swing.
    """

    folder: Path
    rows: list[tuple[str, str, str]]
    notes: list[str] = field(default_factory=list)
    stands: bool = True


def make(urdf: Path, out: Path) -> Result:
    """Write a robot folder from a URDF.

    Args:
        urdf: The URDF.
        out: New folder.

    Raises:
        MissingFileError: There is no such URDF.
        ParameterError: The URDF is broken, the folder exists, or no gains hold the robot.
    """
    if not urdf.is_file():
        raise MissingFileError(f"there is no URDF at {urdf}; name a .urdf, .xacro or .xml file")
    if out.exists():
        raise ParameterError(f"{out} exists already; give another folder with --out")
    draft = Draft(urdf, Tidied(urdf))
    try:
        return _build(draft, out)
    except ParameterError as error:
        if not draft.tidied.suspects:
            raise
        effect = str(error).removeprefix(f"{urdf}: ")
        units = "; ".join(draft.tidied.suspects)
        raise ParameterError(f"{urdf}: {units}. As it is written: {effect}") from None


def _build(draft: Draft, out: Path) -> Result:
    urdf = draft.urdf
    _check(urdf, draft, bolted=True)
    if not draft.description().joint_types():
        raise ParameterError(f"{urdf}: no joint of it moves, so there is nothing to drive")
    rng = np.random.default_rng(SEED)
    standing = _floating(draft, urdf, rng)
    if standing is not None:
        standing = _arms_locked(draft, *standing, rng)
    if standing is not None:
        result = _try(draft, out, *standing, rng)
        if result is not None:
            return result
    draft.locked = {}  # those of a gait
    return _bolted(draft, out, rng)


def _check(urdf: Path, draft: Draft, bolted: bool) -> None:
    faults = list(problems(draft.root, urdf.resolve().parent, bolted))
    if faults:
        suffix = f" (and {len(faults) - 1} more)" if len(faults) > 1 else ""
        raise ParameterError(f"{urdf}: {faults[0]}{suffix}")


# ---- standing robots


def _floating(
    draft: Draft, urdf: Path, rng: np.random.Generator
) -> tuple[list[Support], Posture, float] | None:
    """Supports and posture of a robot that can stand, and its size; None if it cannot."""
    root = draft.description().root_link()
    if root in WORLDS:
        draft.notes.append(f"bolted, as its root link is {root!r}")
        return None
    with probe(draft.description().text(), draft.folder) as first:
        q = first.body.nominal()
        up, contacts = _upwards(first, q, rng)
        if not contacts:
            draft.notes.append("bolted, as fewer than three feet or wheels reach below its base")
            return None
        if mass_of(draft.tidied.link(root)) > 0.0 and up == "z":
            _, place = first.body.forward(q)
            if legs.facing(first.body, contacts, place) is None:
                return _posture(draft, first, contacts, q, rng)
    if up != "z":
        rotation = np.reshape(rotation_matrix(UPWARDS[up]), (3, 3))
        draft.tidied.turn_root(root, rotation)
        draft.rotation_notes.append(f"{up} of the base is up")
    draft.tidied.float_root(root)
    _check(urdf, draft, bolted=False)
    with probe(draft.description().text(), draft.folder) as rotated:
        contacts = supports(rotated, q, rng)
        yaw = legs.facing(rotated.body, contacts, rotated.body.forward(q)[1])
        if yaw is None:
            return _posture(draft, rotated, contacts, q, rng)
    draft.tidied.turn_root(root, yaw)
    draft.rotation_notes.append("turned so that the legs named front are at +x")
    with probe(draft.description().text(), draft.folder) as final:
        return _posture(draft, final, supports(final, q, rng), q, rng)


def _arms_locked(
    draft: Draft, on_ground: list[Support], posture: Posture, size: float, rng: np.random.Generator
) -> tuple[list[Support], Posture, float] | None:
    """Supports, posture and size of a quadruped after locking all joints except those of its legs.

    The gait moves only legs; other robots are returned unchanged.
    """
    body = draft.body()
    named = legs.section(body, on_ground, posture)
    leg_joints = {leg[key] for leg in named.values() for key in legs.JOINTS}
    rest = {j: q for j, q in zip(body.joints, posture.q, strict=True) if j not in leg_joints}
    if not named or not rest:
        return on_ground, posture, size
    no_load = np.zeros(len(body.joints))
    draft.guess_limits(body, no_load, {}, np.random.default_rng(SEED), rest)
    draft.lock(rest, ARMS)
    with probe(draft.description().text(), draft.folder) as final:
        q = final.body.nominal()
        return _posture(draft, final, supports(final, q, rng), q, rng)


def _posture(
    draft: Draft, final: Probe, supports: list[Support], q: np.ndarray, rng: np.random.Generator
) -> tuple[list[Support], Posture, float] | None:
    """Supports, posture and size of a robot in its final frame; None if it cannot stand."""
    posture = Search(final, supports, q, rng).find()
    size = final.size(q)
    if posture.uneven > LEVEL * size * 2.0:
        draft.notes.append(
            f"bolted, as no posture puts its feet level ({posture.uneven:.3f} m off)"
        )
        return None
    if posture.margin <= 0.0:
        outside = f"{-posture.margin:.2f} m outside its {len(supports)} points of support"
        draft.notes.append(f"bolted, as its centre of mass is {outside}")
        return None
    return supports, posture, size


def _upwards(first: Probe, q: np.ndarray, rng: np.random.Generator) -> tuple[str, list[Support]]:
    """Axis of the base that points up, and the supports in that orientation."""
    contacts = supports(first, q, rng)
    if stands_at(first, q) or _is_sufficient(contacts, 3):
        return "z", contacts if _is_sufficient(contacts, 2) else []
    for up, orientation in UPWARDS.items():
        first.up = orientation
        if up != "z" and stands_at(first, q):
            alternative = supports(first, q, rng)
            if _is_sufficient(alternative, 2):
                return up, alternative
    first.up = UPWARDS["z"]
    return "z", contacts if _is_sufficient(contacts, 2) else []


def _is_sufficient(supports: list[Support], count: int) -> bool:
    """Whether supports suffice: three points, or two feet with three joints each."""
    return len(supports) >= max(count, 3) or (
        len(supports) == 2 == count and all(len(s.chain) > 2 and not s.wheel for s in supports)
    )


def _try(
    draft: Draft, out: Path, supports: list[Support], posture: Posture, size: float,
    rng: np.random.Generator,
) -> Result | None:  # fmt: skip
    """Write the robot with the first gains that pass the trial; None if none do."""
    body, draft.size = draft.body(), size
    wheels = [s.chain[-1] for s in supports if s.wheel]
    bodies = [s.body for s in supports]
    _, place = body.forward(posture.q)
    radii = {w: max(1e-3, place[w][2] + posture.height) for w in wheels}
    loads = body.weight_torque(posture.q, bodies, posture.feet)
    draft.guess_limits(body, loads, radii, rng)
    draft.legs = legs.section(body, supports, posture)
    for stiffer, preset in _attempts(draft):
        gains = gain.choose(body, posture.q, posture.feet, bodies, wheels, False, stiffer, preset)
        with Folder(draft, out, body, posture.q, gains, supports, posture.height) as folder:
            outcome = trial.stand(folder.robot(), size)
            if not outcome.fault:
                folder.keep()
                return Result(out, folder.rows(outcome, posture), draft.all_notes(), True)
            draft.reject_gains(outcome.fault)
    draft.notes.append(f"bolted, as it does not stand: {outcome.fault}")
    draft.legs = {}
    return None


def _attempts(draft: Draft) -> Iterator[tuple[float, dict[str, tuple[float, float]]]]:
    """Factor on the stiffness and known gains of each trial: those of the file come first."""
    if draft.gains:
        yield 1.0, draft.gains
    yield from ((stiffer, {}) for stiffer in STIFFER)


# ---- robots with fixed base


def _bolted(draft: Draft, out: Path, rng: np.random.Generator) -> Result:
    body = draft.body()
    q = _middle(body)
    amplitude = _swing(body, q)
    _mimic(draft, body, q, amplitude)
    with probe(draft.description().text(), draft.folder) as final:
        draft.size = final.size(q)
    draft.guess_limits(body, body.weight_torque(q, [], limits.NO_FEET), {}, rng)
    effort, pace = draft.description().efforts(), 2.0 * np.pi * trial.SWING
    effort = np.array([effort[joint] for joint in body.joints])
    q, amplitude, notes = limits.held(body, q, amplitude, effort, pace)
    draft.notes += notes
    _mimic(draft, body, q, amplitude)
    height = _clear(draft, body, rng)
    missed: list[tuple[str, ...]] = []
    for stiffer, preset in _attempts(draft):
        gains = gain.choose(body, q, limits.NO_FEET, [], [], True, stiffer, preset)
        with Folder(draft, out, body, q, gains, [], height, amplitude) as folder:
            robot = folder.robot()
            order = [body.joints.index(joint) for joint in robot.joints]
            outcome = trial.swing(robot, amplitude[order])
            if not outcome.fault:
                folder.keep()
                return Result(out, folder.rows(outcome, None), draft.all_notes(), False)
            if preset:
                draft.reject_gains(outcome.fault)
                continue
            missed += [outcome.missed] * bool(outcome.missed)
    stuck, mimics = min(missed, key=len, default=()), draft.description().mimics()
    both = zip(body.joints, q, strict=True)
    rest = {j: at for j, at in both if {j, mimics.get(j, (j,))[0]} & set(stuck)}
    if not 0 < len(rest) < len(body.joints):
        raise ParameterError(f"{draft.urdf}: no gains were found: {outcome.fault}")
    draft.lock(rest, STUCK)
    draft.notes = [note for note in draft.notes if note not in notes]
    return _bolted(draft, out, rng)


def _middle(body: Body) -> np.ndarray:
    """Centre of the swing, (n,): zero, or the nearest position a quarter of the range inside."""
    limited = np.isfinite(body.high - body.low)
    margin = np.where(limited, 0.25 * (body.high - body.low), 0.0)
    return np.clip(0.0, body.low + margin, body.high - margin)


def _swing(body: Body, q: np.ndarray) -> np.ndarray:
    """Swing amplitude of each joint within its range [rad or m], (n,)."""
    span = np.where(np.isfinite(body.high - body.low), body.high - body.low, np.inf)
    return np.minimum(np.where(body.slides, SWING[1], SWING[0]), SHARE * span)


def _mimic(draft: Draft, body: Body, q: np.ndarray, amplitude: np.ndarray) -> None:
    """Let joints with ``<mimic>`` swing with the joint that they follow, in place."""
    for name, (leader, factor, offset) in draft.description().mimics().items():
        if name not in body.joints or leader not in body.joints:
            continue
        i, lead = body.joints.index(name), body.joints.index(leader)
        q[i] = np.clip(factor * q[lead] + offset, body.low[i], body.high[i])
        amplitude[i] = factor * amplitude[lead]
        if name not in draft.mimics:
            draft.mimics.append(name)


def _clear(draft: Draft, body: Body, rng: np.random.Generator) -> float:
    """Base height at which a fixed-base robot cannot touch the ground in any pose [m].

    It is a bound from the lengths of all links (`clearance`), so that the robot can be
    simulated without the engine; from random poses if the size of a mesh is unknown.
    """
    lowest = clearance(draft.description(), 0.0, draft.folder)
    with probe(draft.description().text(), draft.folder) as final:
        gap = SPACE * min(1.0, final.size(_middle(body)))
        if not np.isfinite(lowest):
            low = np.where(np.isfinite(body.low), body.low, -np.pi)
            high = np.where(np.isfinite(body.high), body.high, np.pi)
            poses = low + (high - low) * rng.random((POSES, len(low)))
            heights = [point[2] for q in poses for point in final.lowest(q).values()]
            lowest = 1.1 * min(heights, default=0.0)
    return height_above(lowest, gap)
