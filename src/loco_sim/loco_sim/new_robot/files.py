# SPDX-License-Identifier: Apache-2.0
"""The files of a new robot: URDF, ``robot.yaml``, ``experiment.yaml``, ``picture.png``."""

from __future__ import annotations

import os
import shutil
import tempfile
import xml.etree.ElementTree as ET
from collections import Counter
from collections.abc import Collection, Iterable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import yaml

from loco_control.exceptions import ParameterError

from ..foreign.notes import listed
from ..foreign.read import stem
from ..foreign.tidy import Tidied
from ..robot import robot as robots
from ..robot.description import Description
from .body import Body
from .gains import Gains, choose
from .limits import NO_FEET, guess
from .picture import picture
from .posture import Posture
from .supports import Support
from .trial import STAND_TIME, SWINGS, Outcome

RATE = 250.0  # control rate [Hz]
TILT = 0.8  # tilt beyond which a robot has fallen [rad]
TALL = 0.2  # base height, as a share of the size, from which a low base means a fall
LOW = 0.5  # share of the base height below which a robot has fallen
READ, GUESSED, TESTED = "read", "guessed", "tried"


@dataclass
class Draft:
    """Intermediate state of the conversion of a URDF to a robot folder.

    Attributes:
        urdf: Path of the original file.
        tidied: The repaired URDF.
        notes: Sentences for the user.
        rotation_notes: Sentences about rotations of the base frame.
        guessed_limits: Joint and kind (effort or velocity) of each guessed limit.
        mimics: Joints that follow another one in the URDF.
        legs: Section ``legs`` of ``robot.yaml``.
        locked: Position [rad or m] of each joint that is locked by ``robot.yaml``, and why.
        size: Longest side of the robot [m].
    """

    urdf: Path
    tidied: Tidied
    notes: list[str] = field(default_factory=list)
    rotation_notes: list[str] = field(default_factory=list)
    guessed_limits: list[tuple[str, str]] = field(default_factory=list)
    mimics: list[str] = field(default_factory=list)
    legs: dict[str, dict[str, str]] = field(default_factory=dict)
    locked: dict[str, tuple[float, str]] = field(default_factory=dict)
    size: float = 1.0

    @property
    def root(self) -> ET.Element:
        """Element of the robot."""
        return self.tidied.root

    @property
    def folder(self) -> Path:
        """Folder of the URDF."""
        return self.urdf.resolve().parent

    def text(self) -> str:
        """Text of the current URDF, without the locks of ``robot.yaml``."""
        ET.indent(self.root)
        return ET.tostring(self.root, encoding="unicode")

    def description(self) -> Description:
        """Description of the current URDF, with the locked joints fixed."""
        description = Description(self.text())
        for joint, (position, _) in self.locked.items():
            description.lock(joint, position)
        return description

    def body(self) -> Body:
        """Tree of bodies of the current URDF, with the locked joints fixed."""
        return Body(self.description(), self.tidied.rotors)

    def lock(self, positions: dict[str, float], reason: str) -> None:
        """Lock joints at positions [rad or m] by the key `locked` of ``robot.yaml``."""
        self.locked |= {joint: (position, reason) for joint, position in positions.items()}
        self.mimics = [joint for joint in self.mimics if joint not in positions]

    def guess_limits(
        self, body: Body, loads: np.ndarray, wheels: dict[int, float], rng: np.random.Generator,
        only: Collection[str] | None = None,
    ) -> None:  # fmt: skip
        """Set limits of joints without usable ones; arguments as of `limits.guess`."""
        guessed, notes = guess(self.root, body, loads, wheels, self.size, rng, only)
        self.guessed_limits = list(dict.fromkeys([*self.guessed_limits, *guessed]))
        if notes and self.tidied.suspects:
            notes = [
                f"effort limits of {len(notes)} joints, far below what this needs, are not used"
            ]
        self.notes += notes

    @property
    def gains(self) -> dict[str, tuple[float, float]]:
        """Stiffness and damping of the position actuators in the file, by joint."""
        return self.tidied.rotors.gains

    def reject_gains(self, fault: str) -> None:
        """Drop the gains of the file, which fail the trial with a fault."""
        if self.gains:
            stiffness = [kp for kp, _ in self.gains.values()]
            self.notes.append(
                f"gains of the actuators in the file (kp {min(stiffness):.3g} to "
                f"{max(stiffness):.3g}) are not used: {fault}"
            )
            self.gains.clear()

    def freed(self) -> tuple[list[str], Gains | None]:
        """The locked joints, and gains of drives for them once they are free (no others)."""
        if not self.locked:
            return [], None
        body = Body(Description(self.text()), self.tidied.rotors)
        names = [joint for joint in body.joints if joint in self.locked]
        q = [self.locked[j][0] if j in self.locked else 0.0 for j in body.joints]
        full = choose(body, np.array(q), NO_FEET, [], [], True)
        index = [body.joints.index(joint) for joint in names]
        armature = (full.armature + body.armature)[index]
        return names, Gains(full.kp[index], full.kd[index], armature, full.steps)

    @property
    def loose(self) -> set[str]:
        """Joints with a spring and without a drive."""
        return self.tidied.rotors.idle & set(self.tidied.rotors.springs)

    def all_notes(self) -> list[str]:
        """Notes about repaired faults, then those about decisions."""
        extra = [f"commands made from those of the joints that they mimic: {listed(self.mimics)}"]
        reasons = {reason: [] for _, reason in self.locked.values()}
        for joint, (_, reason) in self.locked.items():
            reasons[reason].append(joint)
        locks = [
            f"locked in robot.yaml, as {reason}: {listed(names)}"
            for reason, names in reasons.items()
        ]
        extra = extra if self.mimics else []
        return [*self.tidied.notes, *extra, *locks, *self.notes]


@dataclass
class Folder:
    """Context of a robot folder in a temporary location for a trial; deleted unless it is kept.

    Attributes:
        draft: The robot.
        out: Final location of the folder.
        body: Tree of the robot.
        q: Standing posture, (n,).
        gains: Gains of the drives.
        supports: Supports of the robot; empty for a fixed base.
        height: Height of the base [m].
        amplitude: Swing amplitude of each joint of a fixed-base robot [rad or m], (n,).
    """

    draft: Draft
    out: Path
    body: Body
    q: np.ndarray
    gains: Gains
    supports: list[Support]
    height: float
    amplitude: np.ndarray | None = None

    def __enter__(self) -> Folder:
        """Write URDF and ``robot.yaml`` beside the final location."""
        urdf, values = self.draft.text(), self._yaml()
        above = next(p for p in self.out.resolve().parents if p.is_dir())
        self._place = Path(tempfile.mkdtemp(dir=above, prefix=f".{self.out.name}."))
        os.chmod(self._place, 0o755)
        (self._place / f"{self._stem}.urdf").write_text(urdf + "\n", encoding="utf-8")
        (self._place / "robot.yaml").write_text(values, encoding="utf-8")
        return self

    def __exit__(self, *error: object) -> None:
        """Delete the folder, if it is still there."""
        shutil.rmtree(self._place, ignore_errors=True)

    @property
    def _stem(self) -> str:
        return stem(self.draft.urdf)

    def robot(self) -> robots.Robot:
        """The robot; without the section `legs` if the gait generator does not support its legs."""
        try:
            return robots.load(self._place)
        except ParameterError as error:
            if not self.draft.legs:
                raise
            reason = str(error).split(": ", 1)[-1].split("; ")[0].split(": the gait")[0]
            self.draft.notes.append(f"no `legs:` for the gait generator, as {reason}")
            self.draft.legs = {}
            (self._place / "robot.yaml").write_text(self._yaml(), encoding="utf-8")
            return robots.load(self._place)

    def keep(self) -> None:
        """Write the remaining files and move the folder to its final location."""
        robot = self.robot()
        if not picture(robot, self._place / "picture.png"):
            self.draft.notes.append("no picture, as nothing of it has a shape, length or mass")
        (self._place / "experiment.yaml").write_text(self._experiment(robot), encoding="utf-8")
        self.out.parent.mkdir(parents=True, exist_ok=True)
        os.rename(self._place, self.out)

    # ---- texts

    def _yaml(self) -> str:
        draft, bolted = self.draft, not self.supports
        freed, other = draft.freed()
        lines = [
            f"# A first robot from {draft.urdf.name}, by `loco robot new`. What is marked as",
            "# guessed is not in the URDF: replace it by what you know.",
            f"urdf: {self._stem}.urdf",
            f"fixed_base: {str(bolted).lower()}  # guessed",
            f"joints: [{_names([*self.body.joints, *freed])}]",
        ]
        if freed:
            lines.append("locked:  # guessed; a joint moves once its line is deleted [rad, m]")
            for name in freed:
                position, reason = draft.locked[name]
                lines.append(f"  {_name(name)}: {position + 0.0:.6g}  # {reason}")
        if self.supports:
            lines.append(f"feet: [{_names(s.link for s in self.supports)}]  # guessed")
        if draft.legs:
            lines.append("legs:  # guessed")
            for leg, parts in draft.legs.items():
                inside = ", ".join(f"{key}: {_name(value)}" for key, value in parts.items())
                lines.append(f"  {leg}: {{{inside}}}")
        at = [*self.q, *(draft.locked[name][0] for name in freed)]
        posture = ", ".join(f"{v + 0.0:.5g}" for v in np.round(at, 5))
        lines.append(f"standing: [{posture}]  # guessed [rad, m]")
        if bolted:
            lines.append(f"height: {self.height:g}  # guessed: nothing touches the ground [m]")
        lines.append(f"control_rate: {RATE:g}  # guessed [Hz]")
        lines.append("guessed: [control_rate, drives]  # `loco gap` fits drives; delete once known")
        if (gravity := draft.tidied.rotors.gravity) is not None:
            lines.append(f"sim: {{gravity: {gravity:g}}}  # read [m/s²]")
        lines += self._drives(freed, other)
        if self.supports:
            lines.append("contacts:  # guessed")
            lines += [f"  {_name(s.link)}: {{friction: 1.0}}" for s in self.supports]
            tall = self.height > TALL * draft.size
            low = f"height: {LOW * self.height:.3g}, " if tall else ""
            lines.append(f"fall: {{{low}roll: {TILT}, pitch: {TILT}}}  # guessed [m, rad]")
        return "\n".join(lines) + "\n"

    def _drives(self, freed: list[str], other: Gains | None) -> Iterator[str]:
        """Lines about drives, springs and rotors; arguments from `Draft.freed`."""
        draft, body, gains = self.draft, self.body, self.gains
        origin = "from the actuators of the file" if draft.gains else "guessed"
        yield f"drives:  # {origin}; a kp of 0 is a wheel that follows a velocity"
        every = [*zip(body.joints, gains.kp, gains.kd, gains.armature + body.armature, strict=True)]
        if other is not None:
            every += zip(freed, other.kp, other.kd, other.armature, strict=True)
        for name, kp, kd, _ in every:
            if name not in draft.loose:
                yield f"  {_name(name)}: {{kind: impedance, kp: {kp:.3g}, kd: {kd:.3g}}}"
        yield from self._springs()
        if any(armature > 0.0 for *_, armature in every):
            guessed = "guessed for joints that are too light" if gains.armature.any() else "read"
            yield f"dynamics:  # rotors and gears, {guessed} [kg·m²]"
            for name, *_, value in every:
                if value > 0.0:
                    yield f"  {_name(name)}: {{armature: {value:.3g}}}"

    def _springs(self) -> list[str]:
        """Lines about the springs in the file, for joints that are not locked."""
        springs = self.draft.tidied.rotors.springs
        lines = [
            f"  {_name(name)}: {{kind: linear, stiffness: {stiffness:.6g}, rest: {rest:.6g}}}"
            for name, (stiffness, rest) in springs.items()
            if name in self.body.joints or name in self.draft.locked
        ]
        return ["springs:  # read", *lines] if lines else []

    def _experiment(self, robot: robots.Robot) -> str:
        offset = ", ".join(f"{v + 0.0:.5g}" for v in robot.standing[robot.driven])
        if self.amplitude is None:
            what, seconds, amplitude = "stands", STAND_TIME, "0.0"
        else:
            order = [self.body.joints.index(robot.joints[i]) for i in robot.driven]
            what, seconds = "swings all joints", 10.0
            amplitude = ", ".join(f"{v:.3g}" for v in self.amplitude[order])
        return (
            f"# The first experiment of a new robot: loco run {self.out / 'experiment.yaml'}\n"
            f"name: {_name(self.out.name)}\n"
            f"description: {self._stem} {what} for {seconds:g} s.\n"
            "robot: robot.yaml\n"
            f"duration: {seconds}\n"
            "target:\n"
            "  kind: sine\n"
            "  frequency: 0.5\n"
            f"  amplitude: [{amplitude}]\n"
            f"  offset: [{offset}]\n"
            "  phase: [0.0]\n"
        )

    def _gain_rows(self) -> Iterator[tuple[str, str, str]]:
        """Rows about the gains of the drives, and the rotors that they need."""
        gains, read = self.gains, self.draft.gains
        driven = gains.kp[gains.kp > 0.0]
        kp = f"kp {driven.min():.3g} to {driven.max():.3g}, " if len(driven) else ""
        step = f", {gains.steps} sub-steps" if gains.steps > 1 else ""
        text = f"{kp}kd {gains.kd.min():.3g} to {gains.kd.max():.3g}{step}"
        if read and not all(j in read and read[j][1] > 0.0 for j in self.body.joints):
            text += f"; kp of {len(read)} actuators of the file, the others guessed"
        lowered = [read[joint][1] for joint, kd in zip(self.body.joints, gains.kd, strict=True)
                   if read.get(joint, (0.0, 0.0))[1] > 1.001 * kd]  # fmt: skip
        if lowered:
            text += f"; kd of {len(lowered)} actuators lowered, from {max(lowered):.3g} in the file"
        yield "gains", text, READ if read else GUESSED
        if count := int((gains.armature > 0.0).sum()):
            yield "armature", f"of {count} joints that are too light for gains", GUESSED

    def rows(self, outcome: Outcome, posture: Posture | None) -> list[tuple[str, str, str]]:
        """Rows of the report table: a property, its value, its origin."""
        draft, body = self.draft, self.body
        mass, wheels = body.mass.sum(), sum(s.wheel for s in self.supports)
        slides = int(body.slides.sum())
        moving = f"{len(body.joints)}" + f" move, {len(draft.locked)} locked" * bool(draft.locked)
        meshes = {m.get("filename") for m in draft.root.iter("mesh")}
        rows = [
            ("mass", f"{mass:.3g} kg", READ),
            ("joints", moving + f", {slides} of them slides" * bool(slides), READ),
            ("meshes", f"{len(meshes)}, left where they are" if meshes else "none", READ),
        ]
        rubs = (("damping", body.damping, "N·m·s/rad"), ("dry friction", body.friction, "N·m"))
        if drag := [f"{what} up to {v.max():.3g} {u}" for what, v, u in rubs if v.any()]:
            rows.append(("friction", f"{', '.join(drag)} of the joints", READ))
        if (gravity := draft.tidied.rotors.gravity) is not None:
            rows.append(("gravity", f"{gravity:g} m/s²", READ))
        if draft.rotation_notes:
            rows.append(("base frame", "; ".join(draft.rotation_notes), GUESSED))
        if draft.guessed_limits:
            counts = Counter(kind for _, kind in draft.guessed_limits)
            text = " and ".join(f"{kind} of {count}" for kind, count in sorted(counts.items()))
            rows.append(("limits", f"{text} joints, from the weight and the size", GUESSED))
        if posture is None:
            rows.append(("base", f"bolted {self.height:g} m above the ground", GUESSED))
        else:
            support_text = "feet and wheels" if wheels else "feet"
            kind = "wheels" if wheels == len(self.supports) else support_text
            links = listed([s.link for s in self.supports])
            rows.append(("base", f"floating, on {len(self.supports)} {kind}: {links}", GUESSED))
            rows.append((
                "posture", f"base {posture.height:.3f} m high, mass {posture.margin:.3f} m inside "
                "the polygon of the feet", GUESSED,
            ))  # fmt: skip
        if draft.legs:
            first = next(iter(draft.legs.values()))
            names = ", ".join(first[key] for key in ("haa", "hfe", "kfe"))
            rows.append(("legs", f"lf rf lh rh, lf is {names}", GUESSED))
        rows += self._gain_rows()
        gave = f"joints within {outcome.gave:.3f}, load at most {100.0 * outcome.load:.0f} %"
        if posture is None:
            rows.append(("swings", f"{SWINGS:g} s; {gave} of their effort", TESTED))
        else:
            sank = f"sinks {1e3 * outcome.sank:.1f} mm"
            rows.append(("stands", f"{STAND_TIME:g} s; {sank}, {gave}", TESTED))
        return rows


def _name(name: str) -> str:
    """A name as a YAML scalar, in quotes where YAML would not read it as text."""
    return yaml.safe_dump(name, default_flow_style=True, width=1000).split("\n")[0]


def _names(names: Iterable[str]) -> str:
    return ", ".join(map(_name, names))
