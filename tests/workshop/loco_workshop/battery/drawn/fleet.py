# SPDX-License-Identifier: Apache-2.0
"""All robots of the battery: the listed ones, and one drawn for every number."""

from __future__ import annotations

import re
from dataclasses import replace
from functools import cache

import numpy as np

from loco_control.exceptions import ParameterError

from ..physics import excitation, machines, plant, slots, tree
from ..physics.engine import Engine
from ..physics.machines import GRAVITY, Machine, Record, Sensor
from . import bodies, drives

DRAWN = "drawn"  # in place of a robot: each case draws its own; drawn3: of at most 3 joints
_FAMILY = f"{DRAWN}([1-9]|1[0-2])?"
RATES = (50.0, 2000.0)  # of commands and readings [Hz]
SECONDS, LEAST, LONGEST = (6.0, 40.0), 2.0, 40.0  # of all records, of the shortest, longest [s]
RECORDS = 8  # largest number of records
ROWS = 16_000  # largest number of readings of all records and joints
STEP = (1e-3, 10.0**-4.5)  # of an encoder, share of the amplitude
NOISE = (0.1, 3.0)  # of an encoder [steps]
FINE = 4000.0  # smallest rate of integration [Hz]
FINEST = 100_000.0  # largest rate of integration [Hz]
INEXACT = 0.2  # largest rms error of the integration, share of the noise of a sensor
STIFF = 0.04  # largest share of a speed that damping takes away in an integration step
COUPLED = 12.0  # largest eigenvalue of `drives.stiffest`; beyond, rotors weigh more
SPRUNG, PASSIVE = 0.3, 0.2  # share of robots with springs, of sprung joints without a drive
NUDGE = 1e-4  # [rad or m]
CALM, LONGEST_SETTLE = 10.0, 8.0  # rest in time constants of the slowest pole, and in [s]
TRIES = 200
KINDS = ("chirp", "steps", "ramp", "mix", "multisine", "walk")


def is_family(name: str) -> bool:
    """Whether a name stands for drawn robots, ``drawn`` or ``drawn3`` (of at most 3 joints)."""
    return re.fullmatch(_FAMILY, name) is not None


def get(name: str) -> Machine:
    """Machine by name, listed or drawn; shared, so it must not be modified.

    Raises:
        NameUnknownError: There is no machine of that name.
    """
    return draw(name) if is_drawn(name) else machines.get(name)


def is_drawn(name: str) -> bool:
    """Whether a name is that of a drawn robot, such as ``drawn_17`` or ``drawn3_17``."""
    return re.fullmatch(rf"{_FAMILY}_\d+", name) is not None


def groups(machine: Machine) -> tuple[str, ...]:
    """Groups of a machine in the score: its name, or its number of joints and kind of drive."""
    if not machine.drive:
        return (machine.name,)
    n = len(machine.joints)
    count = "1 joint" if n == 1 else "2 or 3 joints" if n < 4 else "4 to 12 joints"
    return f"{DRAWN}, {count}", f"{DRAWN}, {machine.drive}"


@cache
def draw(name: str) -> Machine:
    """The first robot of a number that stands still and moves within its limits."""
    family, _, number = name.partition("_")
    most = int(family.removeprefix(DRAWN) or bodies.MOST)
    for attempt in range(TRIES):
        rng = np.random.default_rng([int(number), 12, attempt])
        machine = _tried(name, most, rng)
        if machine is not None and _moves(machine):
            machine = exact(machine)
            if machine.rate * machine.steps <= FINEST:
                return machine
    raise ParameterError(f"no robot was found for {name!r} in {TRIES} draws; name another seed")


def _moves(machine: Machine) -> bool:
    """Whether the robot follows its records within its limits, whatever the integration step."""
    quick = replace(machine.with_steps(machine.steps // 2), jitter=0.0)
    body, noise = machine.body, np.array([max(s.step, s.noise) for s in machine.sensors])
    for record in machine.records:
        moved = excitation.command(machine, record.name, 1)
        seen = plant.truth(quick, (), moved)[1]
        again = plant.truth(plant.coarser(quick), (), moved)[1]
        often = max(1, len(again) // 400), max(1, len(seen) // 400)
        if not np.isfinite(seen).all() or not np.isfinite(again).all():
            return False
        room = 0.02 * (body.upper - body.lower)
        if np.any(seen < body.lower + room) or np.any(seen > body.upper - room):
            return False
        ends = [
            np.std(part[::step], axis=0) for part, step in zip((again, seen), often, strict=True)
        ]
        if np.any(np.abs(ends[0] - ends[1]) > noise):
            return False
    return True


def exact(machine: Machine) -> Machine:
    """The robot with so many integration steps that their error is far below the sensor noise.

    The error is of order 1: a step is off by twice the difference to half of it.
    """
    noise = np.array([np.hypot(s.noise, s.step / np.sqrt(12.0)) for s in machine.sensors])
    most = 1.0
    for record in machine.records:
        moved = excitation.command(machine, record.name, 1)
        runs = [plant.truth(machine.with_steps(by * machine.steps), (), moved)[:2] for by in (1, 2)]
        coarse, fine = (seen[:: round(1.0 / (machine.rate * t[1]))] for t, seen in runs)
        error = 2.0 * np.sqrt(np.mean(np.square(fine - coarse), axis=0))
        most = max(most, float(np.max(error / noise)) / INEXACT)
    return replace(machine, steps=machine.steps * int(np.ceil(most)), quick=machine.steps // 2)


def _tried(name: str, most: int, rng: np.random.Generator) -> Machine | None:
    """A robot; None if it does not find its rest soon enough."""
    body, root = bodies.draw(rng, most)
    n = len(body.joints)
    some = np.ones(n)
    # Weights and inertias do not depend on efforts and damping, which follow from them.
    rough = tree.read(bodies.finished(root, some, 0.0 * some, some), body.joints)
    rough.armature[:] = _rotors(rng, rough, body.start)
    engine = Engine(rough, 1e-3, GRAVITY)

    def holding(q: np.ndarray) -> np.ndarray:
        return engine.needed(q, 0.0 * some, 0.0 * some)

    mass, weight = engine.mass(body.start), holding(body.start)
    loop = drives.draw(rng, mass, weight, body)
    springs = _springs(rng, loop, body, weight)
    turned = [holding(body.start + by) - holding(body.start - by) for by in NUDGE * np.eye(n)]
    slopes = np.stack(turned, axis=1) / (2.0 * NUDGE)
    slowest = float(drives.poles(loop.rows, springs, mass, slopes).real.max())
    if slowest > -CALM / LONGEST_SETTLE:
        return None
    fast = body.span * 2.0 * np.pi * loop.frequency * rng.uniform(0.6, 1.5)
    viscous = np.where(rng.random(n) < 0.4, 0.03 * loop.damping, 0.0)
    driven = np.flatnonzero(loop.rows[:, 0] != slots.FREE)
    text = bodies.finished(root, loop.rows[:, 8], viscous, fast)
    whole = tree.read(text, body.joints)
    whole.armature[:] = rough.armature
    rate, readings, steps = _rates(rng, loop, mass, n)
    records = _records(rng, rate, readings, n)
    step = body.span * np.exp(rng.uniform(*np.sort(np.log(STEP))))
    noise = step * np.exp(rng.uniform(*np.log(NOISE)))
    telling = {"tau": rng.random() < 0.35 and not readings, "speed": rng.random() < 0.3}
    told = rng.random() < 0.5
    share = (float(rng.uniform(0.03, 0.06)), float(rng.uniform(0.04, 0.08)))
    doubt = (*(round(s, 3) for s in share), 0.02, 0.02) if told else machines.DEVIATION
    off = (
        (min(0.1, 2.0 * doubt[0]), min(0.1, 2.0 * doubt[1]), machines.OFF[2])
        if told
        else machines.OFF
    )
    jitter = float(rng.uniform(0.02, 0.2)) / (readings or rate) if rng.random() < 0.3 else 0.0
    if telling["tau"]:  # a torque is the mean over an even period
        jitter = 0.0
    rest = np.where(springs[:, 0] > 0.0, springs[:, 3], body.start)
    return Machine(
        name, whole, rate, loop.rows, springs, body.start, rest,
        tuple(Sensor(float(s), float(e)) for s, e in zip(step, noise, strict=True)),
        body.start[driven], body.span[driven], fast[driven],
        (loop.frequency / 10.0, loop.frequency),
        torque_noise=float(np.median(loop.rows[:, 8]) * 10.0 ** rng.uniform(-3.0, -2.0))
        if telling["tau"] else 0.0,
        steps=steps, urdf=text, commands=loop.commands, weight=loop.weight, records=records,
        readings=readings, jitter=jitter, doubt=doubt, off=off,
        speed_noise=fast * 10.0 ** rng.uniform(-3.0, -2.0) if telling["speed"] else None,
        settle=-CALM / slowest, drive=loop.kind + " held" * bool(np.any(loop.rows[:, 9])),
        about=_about(body, loop, springs, whole.armature, rate, doubt, told),
    )  # fmt: skip


def _rotors(rng: np.random.Generator, rough: tree.Tree, start: np.ndarray) -> np.ndarray:
    """Inertias of rotors [kg·m²], (n,): none, or as much as a chain needs to be driven."""
    mass = Engine(rough, 1e-3, GRAVITY).mass(start)
    own = np.diag(mass)
    share = rng.uniform(0.05, 0.6, len(own)) * (rng.random() < 0.5)
    while drives.stiffest(mass + np.diag(share * own)) > COUPLED:
        share = share + 0.1
    return np.array([float(f"{value:.4g}") for value in share * own])


def _springs(
    rng: np.random.Generator, loop: drives.Loop, body: bodies.Body, weight: np.ndarray
) -> np.ndarray:
    """Constants of springs, (n, slots.SPRING); takes the drive off passive joints.

    All joints whose drives are told torques have springs, since nothing else holds them.
    """
    n = len(weight)
    springs = np.zeros((n, slots.SPRING))
    alone = loop.kind == "torque"
    if not alone and (loop.weight or rng.random() >= SPRUNG):
        return springs
    for j in range(n):
        passive = not alone and j > 0 and rng.random() < PASSIVE
        if not alone and not passive and rng.random() < 0.6:
            continue
        stiffness = loop.stiffness[j] * (1.0 if alone or passive else rng.uniform(0.2, 1.0))
        damping = loop.damping[j] * (rng.uniform(0.1, 0.4) if alone or passive else 0.02)
        rest = body.start[j] + (weight[j] / stiffness if passive else 0.0)
        if not alone and not passive:
            rest += rng.uniform(-0.3, 0.3) * body.span[j]
        springs[j, :4] = 1.0, *(float(f"{x:.4g}") for x in (stiffness, damping, rest))
        if passive:
            loop.rows[j] = 0.0
    return springs


def _rates(
    rng: np.random.Generator, loop: drives.Loop, mass: np.ndarray, n: int
) -> tuple[float, float, int]:
    """Rate of the commands, of the readings (0: the same) [Hz], and integration steps per tick.

    Some torques are then sampled and held, if the loop remains steady.
    """
    together = drives.stiffest(mass)
    slowest = max(RATES[0], 8.0 * loop.frequency * np.sqrt(together))
    usual = [r for r in (50, 60, 80, 100, 120, 125, 200, 250, 400, 500, 800, 1000, 1600, 2000)
             if r <= RATES[1] / np.sqrt(n)]  # fmt: skip
    rates = [r for r in usual if r >= slowest] or usual[-1:]
    rate = float(rng.choice(rates))
    times = float(rng.choice([1.0, 1.0, 1.0, 0.5, 2.0]))
    readings = rate * times if times != 1.0 and RATES[0] <= rate * times <= RATES[1] else 0.0
    fastest = float(np.max(loop.damping / np.diag(mass))) * together
    if rng.random() < drives.HELD and loop.kind != "torque":
        period = 1.0 / (rate * rng.choice([1, 2, 4]))
        if fastest * period < drives.STEADY:
            drives.held(loop, float(period), 1.0 / rate)
    least = max(FINE, fastest / STIFF) / rate
    return rate, readings, 12 * int(np.ceil(least / 12.0))


def _records(rng: np.random.Generator, rate: float, readings: float, n: int) -> tuple[Record, ...]:
    """Records of drawn kinds and durations; the last of several is held out."""
    most = min(SECONDS[1], max(SECONDS[0], ROWS / n / max(rate, readings)))
    total = np.exp(rng.uniform(np.log(SECONDS[0]), np.log(most)))
    count = int(rng.integers(1, 1 + min(RECORDS, int(total / LEAST))))
    parts = rng.dirichlet(np.full(count, 3.0)) * (total - LEAST * count) + LEAST
    kinds = rng.choice(KINDS, count)
    return tuple(
        Record(f"{i + 1}_{kind}", str(kind), min(LONGEST, round(float(part), 1)),
               count > 1 and i == count - 1)
        for i, (kind, part) in enumerate(zip(kinds, parts, strict=True))
    )  # fmt: skip


def _about(
    body: bodies.Body, loop: drives.Loop, springs: np.ndarray, rotors: np.ndarray, rate: float,
    doubt: tuple[float, ...], told: bool,
) -> dict:  # fmt: skip
    """Contents of robot.yaml that the user of the robot writes beside the URDF."""
    physics = rate * np.ceil(1000.0 / rate)
    values: dict = {
        "drives": {
            joint: section
            for joint, section, row in zip(body.joints, loop.told, loop.rows, strict=True)
            if row[0] != slots.FREE
        },
        "springs": {
            joint: {"kind": "linear", "stiffness": float(row[1]), "damping": float(row[2]),
                    "rest": float(row[3])}
            for joint, row in zip(body.joints, springs, strict=True) if row[0]
        },
        "dynamics": {
            joint: {"armature": float(rotor)}
            for joint, rotor in zip(body.joints, rotors, strict=True) if rotor
        },
        "sim": {"physics_rate": float(physics)},
    }  # fmt: skip
    if told:
        values["uncertain"] = {"bodies.*.mass": f"{100 * doubt[0]:g}%",
                               "bodies.*.inertia": f"{100 * doubt[1]:g}%"}  # fmt: skip
    return {key: value for key, value in values.items() if value}
