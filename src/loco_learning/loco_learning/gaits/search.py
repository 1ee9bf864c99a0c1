# SPDX-License-Identifier: Apache-2.0
"""Search for gaits: oscillator parameters with the highest forward speed, by rollouts.

Step one of the two-steps learning: open loop, sensors unused. As in thesis section 5.3.2,
frequency and phases within the pairs are given; amplitude, duty factor and offset of front
and hind legs and the phase between the pairs are searched, seven numbers. The value of a
rollout is minus its mean forward speed; standing is 0, a fall is 1 to 2, smaller for a later
fall, and a simulation that diverges 10, so that

    walking < standing < falling < diverging.

Ranges are those of the author's gait optimisation (amplitudes to 44.7 degrees, offsets of
60 degrees); the phase ranges are narrower, so that a bound remains a bound and a walk a walk.
Optionally each point is evaluated on several bodies whose stiffness, friction and masses are
drawn around the nominal ones; all points have the same bodies, and the result is checked on
others.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from loco_control.exceptions import NameUnknownError, ParameterError
from loco_control.gait.oscillators import CpgParams, pattern
from loco_control.params import Params, parameter, to_dict
from loco_sim.robot.description import Description

from ..jobs.kept import digest
from ..runs.experiment import Experiment
from ..runs.gait_file import Gait
from ..runs.log import Log
from ..runs.rollout import rollout
from ..search.population import Optimum, PopulationParams, Progress, Score, minimise

FRONT, HIND = [0, 1], [2, 3]  # among the driven joints, lf rf lh rh
BOUNDS = {
    "amplitude_front": (0.0, 0.78),  # [rad]
    "amplitude_hind": (0.0, 0.78),
    "duty_front": (0.1, 0.9),  # [-]
    "duty_hind": (0.1, 0.9),
    "offset_front": (-1.05, 1.05),  # [rad]
    "offset_hind": (-1.05, 1.05),
}
PHASES = {  # lead of the second pair over the first [strides]
    "bound": (0.25, 0.75),  # hind legs, after the front legs
    "walk": (0.35, 0.65),  # rf and lh, after lf and rh
}
GAITS = {f"tigrillo_{name}": name for name in PHASES}
LEGGED = {"hyq_trot": "trot", "hyq_walk": "walk"}  # gaits of the foot trajectory generator
FALL, EXPLODED = 1.0, 10.0  # values of failed rollouts
FASTEST = 5.0  # mean speed above which a rollout has diverged [m/s]
FACTORS = (0.3, 3.0)  # range of a drawn parameter, relative to the nominal one
CHECKS = 16  # other bodies on which a result is checked
DIGITS = 4  # decimal places of the parameters of a gait in its file


@dataclass(frozen=True)
class GaitSearchParams(Params):
    """Aim of a search for a gait, and the bodies on which it is evaluated."""

    gait: str = parameter("tigrillo_bound", "gait to search", choices=(*GAITS, *LEGGED))
    robot: str = parameter("tigrillo", "name of a robot, or path of a robot.yaml or model.yaml")
    frequency: float = parameter(1.0, "strides per second", "Hz", 0.1, 5.0)
    duration: float = parameter(15.0, "of a rollout", "s", 1.0, 1000.0)
    randomise: float = parameter(
        0.0, "standard deviation of stiffness, friction and masses, relative", "-", 0.0, 1.0
    )
    samples: int = parameter(1, "bodies per evaluation", "-", 1, 100)
    body_seed: int = parameter(0, "seed of the bodies", "-", 0, 2**31 - 1)


class GaitProblem:
    """Objective of a search for `population.minimise`.

    Args:
        params: Aim of the search and its bodies.
        start: Initial parameters by name; default the centre of the bounds.

    Raises:
        ParameterError: The robot has not four driven joints, or an initial value is out of bounds.
        NameUnknownError: `start` has a parameter that is not searched.
    """

    def __init__(self, params: GaitSearchParams, start: dict[str, float] | None = None):
        self.params, self.pattern = params, GAITS[params.gait]
        bounds = {**BOUNDS, "phase": PHASES[self.pattern]}
        middle = {name: 0.5 * (low + high) for name, (low, high) in bounds.items()}
        self._search(bounds, middle, start or {})
        self._nominal = Experiment(robot=params.robot, duration=params.duration)
        count = len(self._nominal.plant.driven)
        if count != 4:
            raise ParameterError(
                f"{params.gait} is searched for robots with 4 driven joints, lf rf lh rh; "
                f"{params.robot!r} has {count}; robots with legs take {' or '.join(LEGGED)}"
            )

    def _search(
        self, bounds: dict[str, tuple[float, float]], usual: dict[str, float], start: dict
    ) -> None:
        """Set names, bounds and start of the search.

        Raises:
            NameUnknownError: `start` has a parameter that is not searched.
        """
        for name in start:
            if name not in usual:
                raise NameUnknownError("gait parameter to start from", name, usual)
        self.names = tuple(bounds)
        self.low, self.high = (np.array([b[i] for b in bounds.values()]) for i in (0, 1))
        self.start = np.array([{**usual, **start}[name] for name in self.names])

    def __getstate__(self) -> dict[str, Any]:
        state = dict(vars(self))
        state.pop("bodies", None)  # drawn again on use
        return state

    def describe(self) -> dict[str, Any]:
        """Identification of the search and the body, for the record of evaluations."""
        e = self._nominal
        return {
            **to_dict(self.params),
            "robot": Path(e.robot).name,
            "content": digest(e.plant),
            "overrides": e.overrides,
            "effects": list(e.effects),
        }

    @cached_property
    def bodies(self) -> list[dict[str, Any]]:
        """Overrides of the robot for each sample."""
        p = self.params
        return draw_bodies(self._nominal, p.randomise, p.samples, p.body_seed)

    def target(self, x: np.ndarray) -> CpgParams:
        """Oscillators for searched parameters x, (7,)."""
        front, hind, phase = (0, 2, 4), (1, 3, 5), float(x[6])
        amplitude, duty, offset = (
            (float(x[f]),) * 2 + (float(x[h]),) * 2 for f, h in zip(front, hind, strict=True)
        )
        second = tuple(phase if p else 0.0 for p in pattern(self.pattern))
        return CpgParams(
            frequency=self.params.frequency,
            amplitude=amplitude,
            duty_factor=duty,
            offset=offset,
            phase=second,
        )

    def run(self, target: CpgParams, body: dict[str, Any]) -> Log:
        """Log of one rollout."""
        overrides = {**self._nominal.overrides, **body}
        return rollout(self._nominal.replace(target=target, overrides=overrides))

    def __call__(self, x: np.ndarray) -> Score:
        """Mean value over the bodies, with the reason of the first failure."""
        target = self.target(x)
        scores = [judge(self.run(target, body)) for body in self.bodies]
        reasons = [s.reason for s in scores if s.reason]
        value = float(np.mean([s.value for s in scores]))
        extra = {"speed": float(np.mean([s.extra["speed"] for s in scores]))}
        return Score(value, reasons[0] if reasons else "", {**extra, "falls": len(reasons)})


def judge(log: Log) -> Score:
    """Score of one rollout."""
    duration = log.experiment.ticks * log.dt
    speed = log.distance / duration if len(log) else 0.0
    extra = {"speed": speed, "distance": log.distance}
    diverged = "finite" in log.fall  # a fall has another reason
    if not math.isfinite(speed) or abs(speed) > FASTEST or diverged:
        return Score(
            EXPLODED, f"exploded: {log.fall or f'{speed:.3g} m/s'}", {**extra, "speed": 0.0}
        )
    if log.fall:
        return Score(FALL + 1.0 - len(log) * log.dt / duration, f"fell: {log.fall}", extra)
    return Score(-speed, "", extra)


def draw_bodies(
    experiment: Experiment, deviation: float, count: int, seed: int
) -> list[dict[str, Any]]:
    """Overrides of bodies around that of an experiment; all equal to it for a deviation of 0.

    Args:
        experiment: Experiment with the nominal body.
        deviation: Standard deviation of each stiffness, friction and mass, relative.
        count: Number of bodies.
        seed: Seed of the draw.
    """
    plant = experiment.plant
    nominal = {f"springs.{j}.stiffness": s.stiffness for j, s in plant.springs.items()}
    nominal |= {f"contacts.{link}.friction": mu for link, mu in plant.friction.items()}
    nominal |= {f"masses.{link}": mass for link, mass in _parts(Description(plant.urdf)).items()}
    rng = np.random.default_rng([seed, 0x6B0D1E5])
    bodies = []
    for _ in range(count):
        factors = np.clip(1.0 + deviation * rng.standard_normal(len(nominal)), *FACTORS)
        drawn = {key: float(v * f) for (key, v), f in zip(nominal.items(), factors, strict=True)}
        bodies.append(drawn if deviation else {})
    return bodies


def _parts(body: Description) -> dict[str, float]:
    """Masses of the branches attached to the base [kg]: the halves of Tigrillo."""
    links = [link for link in body.links() if link != body.root_link()]
    inner = {name for link in links for name in body.below(link)[1:]}
    return {
        link: sum(body.mass_of(name) for name in body.below(link))
        for link in links
        if link not in inner
    }


def search(
    params: GaitSearchParams,
    options: PopulationParams,
    folder: str | Path | None = None,
    start: dict[str, float] | None = None,
    report: Callable[[Progress], Any] | None = None,
    kind: type[GaitProblem] = GaitProblem,
) -> tuple[Gait, Optimum]:
    """Search a gait and check it; resumable as `population.minimise`.

    Args:
        params: Aim of the search and its bodies.
        options: Settings of CMA-ES.
        folder: Folder of the record of evaluations.
        start: Initial parameters by name.
        report: Called with the progress after each generation.
        kind: Class of the objective; see `legged.problem_of`.

    Raises:
        ParameterError: The gait is unknown, or the folder has another search.
    """
    problem = kind(params, start)
    optimum = minimise(problem, options, folder, report)
    return make_gait(problem, optimum, options.seed), optimum


def make_gait(problem: GaitProblem, optimum: Optimum, seed: int) -> Gait:
    """The gait of an optimum with rounded parameters, run on the nominal and on other bodies."""
    x = np.round(optimum.x, DIGITS)
    params, target = problem.params, problem.target(x)
    log = problem.run(target, {})
    gait = Gait(
        name=params.gait,
        robot=params.robot,
        target=target,
        parameters=dict(zip(optimum.names, x.tolist(), strict=True)),
        speed=round(judge(log).extra["speed"], 5),
        distance=round(log.distance, 4),
        duration=params.duration,
        seed=seed,
        evaluations=optimum.evaluations,
        overrides=dict(problem._nominal.overrides),
        randomise=params.randomise,
        samples=params.samples,
    )
    return replace(gait, check=check(problem, target, params.randomise or 0.1))


def check(problem: GaitProblem, target: CpgParams, deviation: float) -> dict[str, float]:
    """Falls and speeds of a gait on bodies that the search did not use."""
    bodies = draw_bodies(problem._nominal, deviation, CHECKS, problem.params.body_seed + 1)
    scores = [judge(problem.run(target, body)) for body in bodies]
    return {
        "randomise": deviation,
        "bodies": CHECKS,
        "falls": sum(bool(s.reason) for s in scores),
        "speed_mean": round(float(np.mean([s.extra["speed"] for s in scores])), 5),
        "speed_worst": round(float(min(s.extra["speed"] for s in scores)), 5),
    }
