# SPDX-License-Identifier: Apache-2.0
"""Mistakes of the model: axes of the URDF, scales of joints, gravity, masses and gains."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from scipy.optimize import least_squares

from loco_sim.robot.clearance import SLIDES
from loco_sim.robot.description import Description
from loco_sim.robot.servo import ImpedanceDrive

from ..recordings import suspect, units
from . import commands, signals
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
    now = {j: np.array([d.kp, d.kd]) for j, d in bench.robot.drives.items() if j in joints}
    gains = {j: by for j in joints if (by := signals.regressed(bench, j))}
    off = [j for j, (by, e) in gains.items() if np.any(np.abs(by - now[j]) > 2.0 * e + 0.01 * by)]
    exact = tuple(c for j in off for c in gained(bench, gains[j][0] / now[j], (j,)))
    after = bench.mended(exact).torques() if off else None
    if after and all(abs(alike) > LIMITS.against and 1.0 / LIMITS.scale < abs(by) < LIMITS.scale
                     for by, alike in (moved(after, j) for j in off)):  # fmt: skip
        texts = (f"{key} of {j} is {by:.4g} ± {error:.1g}" for j in off
                for key, by, error in zip(("kp", "kd"), *gains[j], strict=True))  # fmt: skip
        text = f"{', '.join(texts)} by the measured torque; guessed in robot.yaml"
        return [Finding("guessed gains", tuple(off), text, exact, stops=False)]
    return [] if bench.fits or gains and not off else _fitted(bench, joints)


def _fitted(bench: Bench, joints: Sequence[str]) -> list[Finding]:
    """Finding of gains of some joints that are fitted to the motion."""

    def way(log_by: np.ndarray) -> tuple[Change, ...]:
        by = zip(joints, np.exp(np.reshape(log_by, (-1, 2))), strict=True)
        return tuple(c for j, pair in by for c in gained(bench, pair, (j,)))

    best = np.zeros((len(joints), 2))
    for some in (np.ones(len(joints)), *np.eye(len(joints))):  # all alike, then each by itself
        tried = [best + by * some[:, None] for by in np.log(LIMITS.scales)]
        best = min(tried, key=lambda x: bench.miss(*way(x)))
    best = least_squares(lambda x: (bench(*way(x)) or bench()).misses(), best.ravel(),
                         diff_step=0.05, max_nfev=10).x  # fmt: skip
    says = f"the gains of {', '.join(joints)} are guessed in robot.yaml, and fitted here"
    found = bench.settled("guessed gains", joints, says, [way(best)], whole=True)
    return [replace(finding, stops=False) for finding in found]


def axis(bench: Bench) -> list[Finding]:
    """Findings of up to two joints whose axis in the URDF is reversed."""
    joints = bench().joints
    for count in (1, 2):
        trials = []
        for some in itertools.combinations(joints, count):
            way = tuple(c for joint in some for c in lines(bench, joint, SIGN, -1, ""))
            bare = tuple(c for c in way if c.role != "tau")  # the torque may be right
            trials += [(bench.miss(*way), some, one) for one in dict.fromkeys((way, bare))]
        least = min((miss for miss, _, _ in trials), default=0.0)
        trials = [t for t in trials if t[0] < LIMITS.alike * least + 1e-3]
        ways = bench.supported([way for _, _, way in trials])
        trials = [t for t in trials if t[2] in ways]
        some = tuple(dict.fromkeys(joint for _, some, _ in trials for joint in some))
        names = (" and " if len({t[1] for t in trials}) == 1 else " or ").join(some)
        says = (f"{names} turns the other way round in the URDF than in the recordings: weight and "
                "coupling have the other sign")  # fmt: skip
        found = bench.settled("axis", some, says, ways, whole=True)
        if found:
            return found
    return []


def joint_scale(bench: Bench) -> list[Finding]:
    """Findings of joints whose positions and commands have the same wrong scale.

    All that turn may be in degrees, and all slides in mm. A scale is found only if a smaller and a
    larger one explain less: a motion that must vanish has another cause.
    """
    found = [] if bench.led else _in_units(bench)
    misses = dict(zip(bench().joints, bench().misses(), strict=True))
    for joint in sorted(misses, key=misses.get, reverse=True)[: LIMITS.worst]:
        if misses[joint] < LIMITS.missed or bench.led:
            continue

        def way(log_by: float, joint: str = joint) -> tuple[Change, ...]:
            return lines(bench, joint, SCALE, float(np.exp(-log_by)), "")

        by = float(np.exp(lowest(lambda x: bench.miss(*way(x)), np.log(LIMITS.scales))))
        if 1.0 / LIMITS.both < by < LIMITS.both:
            continue
        unit = commands.named(bench, joint, by)
        if not determined(bench, (joint,), by, bool(unit)):
            continue
        ways = [lines(bench, joint, UNIT, unit, "") if unit else way(float(np.log(by)))]
        says = f"q and command of {joint} are " + (f"in {unit}" if unit else (
            f"{by:.3g} times those of the joint: a scale, or a reduction of the gear"))  # fmt: skip
        found += bench.settled("joint scale", (joint,), says, ways, whole=True)
    return found


def _in_units(bench: Bench) -> list[Finding]:
    """Finding of several joints whose positions and commands are in degrees or mm."""
    types, findings = Description(bench.robot.urdf).joint_types(), list[Finding]()
    slides = tuple(joint for joint in bench().joints if types[joint] == SLIDES)
    turning = tuple(joint for joint in bench().joints if joint not in slides)
    for joints, unit in ((slides, "mm"), (turning, "deg")):
        if len(joints) > 1 and determined(bench, joints, 1.0 / units.factor(unit), True):
            changes = [tuple(c for j in joints for c in lines(bench, j, UNIT, unit, ""))]
            text = f"q and command of {', '.join(joints)} are in {unit}"
            findings += bench.settled("joint scale", joints, text, changes, whole=True)
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
    least = LIMITS.alike * best + 1e-3
    return small > least and large > (best if is_unit else least)


def gravity(bench: Bench) -> list[Finding]:
    """Findings of a wrong direction of gravity, or of gravity that the drives compensate."""
    carried = (Change(MODEL, "sim.gravity", 0.0),)
    says = "the model misses the weight: the drives carry it themselves, or nothing weighs"
    found = bench.settled("gravity carried", (), says, [carried], whole=True)
    about = np.pi * np.array([0.0, 1.0, -0.75, -0.5, -0.35, -0.2, 0.2, 0.35, 0.5, 0.75])
    starts = [*((x, 0.0) for x in about), *((0.0, x) for x in about[2:])]

    def tilted(x: Sequence[float]) -> tuple[Change, ...]:
        spec = {"name": "slope", "pitch": round(float(x[0]), 3), "roll": round(float(x[1]), 3)}
        return (Change(MODEL, EFFECTS, (spec,)),)

    start = min(starts, key=lambda x: bench.miss(*tilted(x)))
    near = least_squares(lambda x: bench.miss(*tilted(np.clip(x, -3.2, 3.2))), start,
                         diff_step=0.02, max_nfev=8).x  # fmt: skip
    near = np.clip(near, -3.2, 3.2)
    angle = float(np.arccos(np.clip(np.cos(near[0]) * np.cos(near[1]), -1.0, 1.0)))
    if angle < LIMITS.tilted:
        return found
    for i in np.flatnonzero(near != start):  # not where the motion does not depend on it

        def missed(x: float, i: int = i) -> float:
            return bench.miss(*tilted([*near[:i], x, *near[i + 1 :]]))

        near[i] = lowest(missed, near[i] + LIMITS.finer * np.array([-1.0, 0.0, 1.0]))
    lies = "upside down" if angle > 0.9 * np.pi else f"inclined by {np.degrees(angle):.0f} degrees"
    turned = f"the weight pulls elsewhere than the model has it: the base is {lies}"
    tilt = bench.settled("gravity turned", (), turned, [tilted(near)], whole=True)
    if not tilt or bench.miss(*carried) > LIMITS.carried * bench.miss(*tilted(near)):
        return tilt or found
    return [replace(tilt[0], fault="gravity carried", says=f"{says}; or {tilt[0].says}",
                    mends=carried, others=(tilted(near),))]  # fmt: skip


def weights(bench: Bench) -> list[Finding]:
    """Finding of masses and inertias, or of torques, that are wrong by a power of ten."""
    found: list[Finding] = []
    for by in POWERS:
        ways = [heavier(bench, by)]
        if bench.led:
            told = MAPPING, SCALE, 1.0 / by, "command_torque"
            ways += [tuple(Change(*told, joint) for joint in bench().joints)]
        elif stiff(bench):
            ways += [gained(bench, (1.0 / by, 1.0 / by), stiff(bench))]
        says = f"all masses are {1.0 / by:g} times too large" if by < 1.0 else \
            f"all masses are {by:g} times too small"  # fmt: skip
        found += bench.settled("masses", (), f"{says} for this motion, or the torques are", ways,
                               whole=True)  # fmt: skip
    return sorted(found, key=lambda f: bench.miss(*f.mends))[:1]


def gains(bench: Bench) -> list[Finding]:
    """Finding of drive gains per degree instead of per radian: of all, all that turn, or one."""
    found: list[Finding] = []
    kinds, drives = Description(bench.robot.urdf).joint_types(), stiff(bench)
    turning = tuple(joint for joint in drives if kinds[joint] != SLIDES)
    for joints in dict.fromkeys((drives, turning, *((joint,) for joint in turning))):
        for by in (suspect.DEGREE, 1.0 / suspect.DEGREE):
            way = gained(bench, (by, by), joints)
            off = f"{max(by, 1.0 / by):.3g} times too {'small' if by > 1.0 else 'large'}"
            says = f"the gains of {', '.join(joints)} are {off}: per degree, not per radian"
            found += bench.settled("gains", joints, says, [way] if joints else [], whole=True)
    return sorted(found, key=lambda f: bench.miss(*f.mends))[:1]


def misread(bench: Bench) -> float:
    """Least error of the model if the zero of one joint sensor has moved, or its gain is off."""
    trial, ways = bench(), []
    said, read = np.concatenate(trial.said), np.concatenate(trial.measured)
    for joint, a, b in zip(trial.joints, said.T, read.T, strict=True) if not bench.led else ():
        gain = float(np.nansum(a * b) / max(np.nansum(b * b * np.isfinite(a)), 1e-12))
        ways.append(Change(MAPPING, OFFSET, float(np.nanmean(a - b)), "q", joint))
        ways.append(Change(MAPPING, SCALE, gain, "q", joint))
    return min((bench.miss(way) for way in ways), default=np.inf)


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
    known = {link: text.mass_of(link) for link in text.links()}
    whole = {link: sum(known[one] for one in text.below(link)) for link in known if known[link]}
    return tuple(Change(MODEL, f"masses.{link}", by * mass) for link, mass in whole.items())


def lowest(miss: Callable[[float], float], grid: Sequence[float]) -> float:
    """Minimum of a function near the best value of an increasing grid, by golden-section search."""
    grid = list(grid)
    k = int(np.argmin([miss(x) for x in grid]))
    low, high = grid[max(k - 1, 0)], grid[min(k + 1, len(grid) - 1)]
    golden = 0.5 * (np.sqrt(5.0) - 1.0)
    for _ in range(LIMITS.sections):
        a, b = high - golden * (high - low), low + golden * (high - low)
        low, high = (low, b) if miss(a) < miss(b) else (a, high)
    return 0.5 * (low + high)
