# SPDX-License-Identifier: Apache-2.0
"""Mistakes of the model: axes of the URDF, scales of joints, gravity, masses and gains."""

from __future__ import annotations

import itertools
import xml.etree.ElementTree as ET
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from scipy.optimize import least_squares

from loco_sim.foreign import units as described
from loco_sim.robot.clearance import SLIDES
from loco_sim.robot.description import Description
from loco_sim.robot.servo import ImpedanceDrive

from ..recordings import units
from . import commands, signals, suspect
from .bench import Bench
from .commands import lines, moved
from .finding import EFFECTS, MAPPING, MODEL, OFFSET, SCALE, SIGN, UNIT, Change, Finding
from .limits import LIMITS

POWERS = (1e-3, 0.1, 10.0, 1e3)  # factors of masses in g, or of another robot's file


def drafted(bench: Bench) -> list[Finding]:
    """Finding, which stops nothing, of gains that `robot new` guessed.

    They follow from the measured torque of a drive; else they are fitted to the motion.
    """
    joints = stiff(bench) if "drives" in bench.robot.guessed else ()
    if not joints or bench.free:
        return []
    old = {j: np.array([d.kp, d.kd]) for j, d in bench.robot.drives.items() if j in joints}
    gains = {j: by for j in joints if (by := signals.regressed(bench, j))}
    wrong = [j for j, (by, e) in gains.items() if np.any(np.abs(by - old[j]) > 2.0 * e + 0.01 * by)]
    exact = tuple(c for j in wrong for c in gained(bench, gains[j][0] / old[j], (j,)))
    after = bench.torques(*exact) if wrong else None
    if after and all(abs(corr) > LIMITS.against and 1.0 / LIMITS.scale < abs(by) < LIMITS.scale
                     for by, corr in (moved(after, j) for j in wrong)):  # fmt: skip
        parts = (f"{key} of {j} is {by:.4g} ± {error:.1g}" for j in wrong
                for key, by, error in zip(("kp", "kd"), *gains[j], strict=True))  # fmt: skip
        text = f"{', '.join(parts)} by the measured torque; guessed in robot.yaml"
        return [Finding("guessed gains", tuple(wrong), text, exact, stops=False)]
    return [] if bench.fits or gains and not wrong else _fitted(bench, joints)


def _fitted(bench: Bench, joints: Sequence[str]) -> list[Finding]:
    """Finding of gains of some joints that are fitted to the motion."""

    def fix(log_by: np.ndarray) -> tuple[Change, ...]:
        by = zip(joints, np.exp(np.reshape(log_by, (-1, 2))), strict=True)
        return tuple(c for j, pair in by for c in gained(bench, pair, (j,)))

    best = np.zeros((len(joints), 2))
    for direction in (np.ones(len(joints)), *np.eye(len(joints))):  # all alike, then each by itself
        candidates = [best + by * direction[:, None] for by in np.log(LIMITS.scales)]
        best = min(candidates, key=lambda x: bench.miss(*fix(x)))
    best = least_squares(lambda x: (bench(*fix(x)) or bench()).errors(), best.ravel(),
                         diff_step=0.02, max_nfev=10).x  # fmt: skip
    note = f"the gains of {', '.join(joints)} are guessed in robot.yaml, and fitted here"
    findings = bench.settled("guessed gains", joints, note, [fix(best)], total=True)
    return [replace(finding, stops=False) for finding in findings]


def axis(bench: Bench) -> list[Finding]:
    """Findings of up to two joints whose axis in the URDF is reversed."""
    joints = bench().joints
    for count in (1, 2):
        trials = []
        for subset in itertools.combinations(joints, count):
            fix = tuple(c for joint in subset for c in lines(bench, joint, SIGN, -1, ""))
            motion = tuple(c for c in fix if c.role != "tau")  # the torque may be right
            trials += [(bench.miss(*fix), subset, one) for one in dict.fromkeys((fix, motion))]
        lowest = min((miss for miss, _, _ in trials), default=0.0)
        trials = [t for t in trials if t[0] < LIMITS.alike * lowest + 1e-3]
        fixes = bench.supported([fix for _, _, fix in trials])
        trials = [t for t in trials if t[2] in fixes]
        subset = tuple(dict.fromkeys(joint for _, subset, _ in trials for joint in subset))
        names = (" and " if len({t[1] for t in trials}) == 1 else " or ").join(subset)
        note = (f"{names} turns the other way round in the URDF than in the recordings: weight and "
                "coupling have the other sign")  # fmt: skip
        findings = bench.settled("axis", subset, note, fixes, total=True)
        if findings:
            return findings
    return []


def joint_scale(bench: Bench) -> list[Finding]:
    """Findings of joints whose positions and commands have the same wrong scale.

    All that turn may be in degrees, and all slides in mm. A scale is found only if a smaller and a
    larger one explain less: a motion that must vanish has another cause.
    """
    findings = [] if bench.led else _in_units(bench)
    misses = dict(zip(bench().joints, bench().misses(), strict=True))
    for joint in sorted(misses, key=misses.get, reverse=True)[: LIMITS.worst]:
        if misses[joint] < LIMITS.missed or bench.led:
            continue

        def fix(log_by: float, joint: str = joint) -> tuple[Change, ...]:
            return lines(bench, joint, SCALE, float(np.exp(-log_by)), "")

        by = float(np.exp(lowest(lambda x: bench.miss(*fix(x)), np.log(LIMITS.scales),
                                 np.log(LIMITS.both))))  # fmt: skip
        if 1.0 / LIMITS.both < by < LIMITS.both:
            continue
        unit = commands.named(bench, joint, by)
        if not determined(bench, (joint,), by, bool(unit)):
            continue
        fixes = [lines(bench, joint, UNIT, unit, "") if unit else fix(float(np.log(by)))]
        note = f"q and command of {joint} are " + (f"in {unit}" if unit else (
            f"{by:.3g} times those of the joint: a scale, or a reduction of the gear"))  # fmt: skip
        findings += bench.settled("joint scale", (joint,), note, fixes, total=True)
    return findings


def _in_units(bench: Bench) -> list[Finding]:
    """Finding of several joints whose positions and commands are in degrees or mm."""
    types, findings = Description(bench.robot.urdf).joint_types(), list[Finding]()
    slides = tuple(joint for joint in bench().joints if types[joint] == SLIDES)
    turning = tuple(joint for joint in bench().joints if joint not in slides)
    for joints, unit in ((slides, "mm"), (turning, "deg")):
        if len(joints) > 1 and determined(bench, joints, 1.0 / units.factor(unit), True):
            changes = [tuple(c for j in joints for c in lines(bench, j, UNIT, unit, ""))]
            text = f"q and command of {', '.join(joints)} are in {unit}"
            findings += bench.settled("joint scale", joints, text, changes, total=True)
    return findings


def determined(bench: Bench, joints: Sequence[str], by: float, is_unit: bool) -> bool:
    """Whether smaller and larger scales of joints than `by` explain less.

    Small motions are linear, so that all larger scales explain about as much: of a unit it is
    enough that smaller ones explain less, and larger ones no more.
    """
    best, small, large = (
        bench.miss(*(c for j in joints for c in lines(bench, j, SCALE, 1.0 / (by * f), "")))
        for f in (1.0, *LIMITS.about)
    )
    lowest = LIMITS.alike * best + 1e-3
    return small > lowest and large > (best if is_unit else lowest)


def gravity(bench: Bench) -> list[Finding]:
    """Findings of a wrong direction of gravity, or of gravity that the drives compensate."""
    no_gravity = (Change(MODEL, "sim.gravity", 0.0),)
    note = "the model misses the weight: the drives carry it themselves, or nothing weighs"
    findings = bench.settled("gravity carried", (), note, [no_gravity], total=True)
    about = np.pi * np.array([0.0, 1.0, -0.75, -0.5, -0.35, -0.2, 0.2, 0.35, 0.5, 0.75])
    starts = [*((x, 0.0) for x in about), *((0.0, x) for x in about[2:])]

    def tilted(x: Sequence[float]) -> tuple[Change, ...]:
        spec = {"name": "slope", "pitch": round(float(x[0]), 3), "roll": round(float(x[1]), 3)}
        return (Change(MODEL, EFFECTS, (spec,)),)

    start = min(starts, key=lambda x: bench.miss(*tilted(x)))
    orientation = least_squares(lambda x: bench.miss(*tilted(np.clip(x, -3.2, 3.2))), start,
                         diff_step=0.02, max_nfev=8).x  # fmt: skip
    orientation = np.clip(orientation, -3.2, 3.2)
    angle = float(np.arccos(np.clip(np.cos(orientation[0]) * np.cos(orientation[1]), -1.0, 1.0)))
    if angle < LIMITS.tilted:
        return findings
    for i in np.flatnonzero(orientation != start):  # not where the motion does not depend on it

        def missed(x: float, i: int = i) -> float:
            return bench.miss(*tilted([*orientation[:i], x, *orientation[i + 1 :]]))

        orientation[i] = lowest(missed, orientation[i] + LIMITS.finer * np.array([-1.0, 0.0, 1.0]))
    pose = "upside down" if angle > 0.9 * np.pi else f"inclined by {np.degrees(angle):.0f} degrees"
    tilt_note = f"the weight pulls elsewhere than the model has it: the base is {pose}"
    tilt = bench.settled("gravity turned", (), tilt_note, [tilted(orientation)], total=True)
    if not tilt or bench.miss(*no_gravity) > LIMITS.carried * bench.miss(*tilted(orientation)):
        return tilt or findings
    return [replace(tilt[0], fault="gravity carried", says=f"{note}; or {tilt[0].says}",
                    mends=no_gravity, others=(tilted(orientation),))]  # fmt: skip


def inertias(bench: Bench) -> list[Finding]:
    """Finding of inertias of the description in another unit, with masses in g or in kg."""
    if bench.free:
        return []
    masses, unit, by = described.factors(ET.fromstring(bench.robot.urdf), bench.robot.folder)
    text = Description(bench.robot.urdf)
    links = [text.child(joint) for joint in bench.robot.joints]
    fix = tuple(Change(MODEL, f"bodies.{link}.inertia", masses / by) for link in links)
    fix += heavier(bench, 1.0 / masses) if masses > 1.0 else ()
    what = f"masses are in g, and inertias in {unit}" if masses > 1.0 else f"inertias are in {unit}"
    note = f"{what}: no bodies of that size have as much"
    return bench.settled("inertias", (), note, [fix], total=True) if unit else []


def weights(bench: Bench) -> list[Finding]:
    """Finding of masses and inertias, or of torques, that are wrong by a power of ten."""
    findings: list[Finding] = []
    for by in POWERS:
        sets = [heavier(bench, by)]
        if bench.led:
            torque_line = MAPPING, SCALE, 1.0 / by, "command_torque"
            sets += [tuple(Change(*torque_line, joint) for joint in bench().joints)]
        elif stiff(bench):
            sets += [gained(bench, (1.0 / by, 1.0 / by), stiff(bench))]
        note = f"all masses are {1.0 / by:g} times too large" if by < 1.0 else \
            f"all masses are {by:g} times too small"  # fmt: skip
        findings += bench.settled("masses", (), f"{note} for this motion, or the torques are", sets,
                               total=True)  # fmt: skip
    return sorted(findings, key=lambda f: bench.miss(*f.mends))[:1]


def gains(bench: Bench) -> list[Finding]:
    """Finding of drive gains per degree instead of per radian: of all, all that turn, or one."""
    findings: list[Finding] = []
    types, drives = Description(bench.robot.urdf).joint_types(), stiff(bench)
    turning = tuple(joint for joint in drives if types[joint] != SLIDES)
    for joints in dict.fromkeys((drives, turning, *((joint,) for joint in turning))):
        for by in (suspect.DEGREE, 1.0 / suspect.DEGREE):
            fix = gained(bench, (by, by), joints)
            ratio = f"{max(by, 1.0 / by):.3g} times too {'small' if by > 1.0 else 'large'}"
            note = f"the gains of {', '.join(joints)} are {ratio}: per degree, not per radian"
            findings += bench.settled("gains", joints, note, [fix] if joints else [], total=True)
    return sorted(findings, key=lambda f: bench.miss(*f.mends))[:1]


def misread(bench: Bench) -> float:
    """Least error of the model if the zero of one joint sensor has moved, or its gain is off."""
    trial, fixes = bench(), []
    sim, read = np.concatenate(trial.said), np.concatenate(trial.measured)
    for joint, a, b in zip(trial.joints, sim.T, read.T, strict=True) if not bench.led else ():
        gain = float(np.nansum(a * b) / max(np.nansum(b * b * np.isfinite(a)), 1e-12))
        fixes.append(Change(MAPPING, OFFSET, float(np.nanmean(a - b)), "q", joint))
        fixes.append(Change(MAPPING, SCALE, gain, "q", joint))
    return min((bench.miss(fix) for fix in fixes), default=np.inf)


def saturated(bench: Bench) -> float:
    """Least error of the model if the drive of one joint gives less torque than it asks for."""
    torques = () if bench.led else bench.drive_torques().items()
    errors = [np.inf]
    for joint, rated in torques:

        def fix(log_by: float, joint: str = joint, rated: float = rated) -> Change:
            limit = {"rated": rated, "reduction": float(-np.expm1(log_by))}
            return Change(MODEL, EFFECTS, ({"name": "torque_limit", "joint": joint, **limit},))

        by = lowest(lambda x: bench.miss(fix(x)), np.log(LIMITS.weaker))
        errors.append(bench.miss(fix(by)))
    return min(errors)


def stiff(bench: Bench) -> tuple[str, ...]:
    """Joints with impedance drives."""
    drives = bench.robot.drives
    return tuple(j for j in bench().joints if isinstance(drives.get(j), ImpedanceDrive))


def gained(bench: Bench, by: Sequence[float], joints: Sequence[str]) -> tuple[Change, ...]:
    """Changes that multiply kp and kd of the impedance drives of some joints by two factors."""
    return tuple(
        Change(MODEL, f"drives.{j}.{key}", float(size * getattr(bench.robot.drives[j], key)))
        for j in joints
        for key, size in zip(("kp", "kd"), by, strict=True)
    )


def heavier(bench: Bench, by: float) -> tuple[Change, ...]:
    """Changes that multiply the masses of all links; inertias follow."""
    text = Description(bench.robot.urdf)
    masses = {link: text.mass_of(link) for link in text.links()}
    trees = {link: sum(masses[one] for one in text.below(link)) for link in masses if masses[link]}
    return tuple(Change(MODEL, f"masses.{link}", by * mass) for link, mass in trees.items())


def lowest(miss: Callable[[float], float], grid: Sequence[float], margin: float = 0.0) -> float:
    """Minimum of a function near the best value of an increasing grid, by golden-section search.

    If 0 is best, and the function is larger at a distance `margin` to both sides, it is 0.
    """
    grid = list(grid)
    values = [miss(x) for x in grid]
    k = int(np.argmin(values))
    if margin and grid[k] == 0.0 and min(miss(-margin), miss(margin)) > values[k]:
        return 0.0
    low, high = grid[max(k - 1, 0)], grid[min(k + 1, len(grid) - 1)]
    golden = 0.5 * (np.sqrt(5.0) - 1.0)
    for _ in range(LIMITS.sections):
        a, b = high - golden * (high - low), low + golden * (high - low)
        low, high = (low, b) if miss(a) < miss(b) else (a, high)
    return 0.5 * (low + high)
