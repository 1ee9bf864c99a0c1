# SPDX-License-Identifier: Apache-2.0
"""Sizes of the effects of a fleet by robot and day, and recordings that they do not explain."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ..probability.weights import CRITERION
from ..statistics import evidence
from ..statistics.leftover import LIMITS, is_noise
from . import pooling
from .course import Course, course
from .params import FleetParams
from .pooling import Mean
from .table import Recording, by_day
from .tasks import Measured


@dataclass(frozen=True)
class Verified:
    """A recording and the sizes of all others of its robot.

    Attributes:
        before: Whitened rms of the given model [floors].
        after: Whitened rms with the pooled sizes [floors].
        explained: Whether each channel is at its floor, or most of its gap is closed.
    """

    before: float
    after: float
    explained: bool


@dataclass(frozen=True)
class Pooled:
    """Sizes as ratios to those of the searches.

    Attributes:
        days: Days of each robot, in order.
        sizes: Size of each robot, effect and day, by robot and index of the effect.
        courses: Course over the days, by robot and index of the effect.
        spreads: Standard deviation of the true size between recordings, and between robots that
            have the effect, by index of the effect.
        means: Size over all robots that have the effect, by index of the effect.
        verified: Verified recordings by file.
    """

    days: dict[str, list[str]]
    sizes: dict[tuple[str, int], list[Mean]]
    courses: dict[tuple[str, int], Course]
    spreads: dict[int, tuple[float, float]]
    means: dict[int, Mean]
    verified: dict[str, Verified]

    def has(self, robot: str, k: int) -> bool:
        """Whether a robot surely has an effect."""
        return self.courses[robot, k].present >= CRITERION.confidence


def pooled(
    rows: Sequence[Recording], measured: Mapping[str, Measured], count: int, params: FleetParams
) -> Pooled:
    """Pool the measured sizes.

    Sizes spread between recordings, and between the days of a robot, by random effects; the spread
    of days counts about the most probable course, which is then sought again.

    Args:
        rows: Recordings, sorted by robot and day.
        measured: Sizes by file.
        count: Number of effects.
        params: Settings.
    """
    index = {key: i for i, key in enumerate(by_day(rows))}
    of = np.array([index[row.robot, row.day] for row in rows])
    days: dict[str, list[str]] = {}
    for robot, day in index:
        days.setdefault(robot, []).append(day)
    sizes, courses = {}, {}
    spreads, means = {}, {}
    for k in range(count):
        y = np.array([measured[row.file].sizes[k] for row in rows])
        v = np.array([measured[row.file].variances[k] for row in rows])
        tolerance = float(np.median([measured[row.file].visible[k] for row in rows]))
        within = pooling.between(y, v, of)
        for robot, names in days.items():
            sizes[robot, k] = [
                pooling.mean(y[members], v[members], within)
                for members in (of == index[robot, day] for day in names)
            ]
        between = params.varies**2
        for _ in range(2):
            for robot in days:
                m, u = np.array(sizes[robot, k]).T
                courses[robot, k] = course(m, u + between, 1.0, tolerance, params.absent)
            between = _between_days([(sizes[robot, k], courses[robot, k]) for robot in days])
        with_it = [robot for robot in days if courses[robot, k].present >= CRITERION.confidence]
        levels = np.array([_largest(courses[robot, k]) for robot in with_it]).reshape(-1, 2)
        robots = pooling.between(*levels.T, [0] * len(levels))
        spreads[k] = float(np.sqrt(within + between)), float(np.sqrt(robots))
        if with_it:
            means[k] = pooling.mean(*levels.T, robots)
    result = Pooled(days, sizes, courses, spreads, means, {})
    _verify(rows, measured, count, result)
    return result


def _between_days(robots: Sequence[tuple[Sequence[Mean], Course]]) -> float:
    """Variance of the true size between days of one robot about its course.

    It is that of robots with the effect; of all robots, if these have it on one day only.

    Args:
        robots: Size of each day, and course, of each robot.
    """
    rows = []
    for r, (sizes, path) in enumerate(robots):
        after = np.arange(len(sizes)) >= (path.change or len(sizes))
        present = path.variances > 0.0
        rows += [(*one, 2 * r + a, t) for one, a, t in zip(sizes, after, present, strict=True)]
    m, u, group, present = np.array(rows).T
    is_present = present > 0.0
    if is_present.sum() == len(np.unique(group[is_present])):
        is_present[:] = True
    return pooling.between(m[is_present], u[is_present], group[is_present])


def _largest(one: Course) -> tuple[float, float]:
    """Size and variance of the day of a course with the largest size."""
    day = int(np.argmax(np.abs(one.sizes)))
    return float(one.sizes[day]), float(one.variances[day])


def _verify(
    rows: Sequence[Recording], measured: Mapping[str, Measured], count: int, result: Pooled
) -> None:
    """Verify each recording by the sizes of the others, without further simulations."""
    for row in rows:
        one, day = measured[row.file], result.days[row.robot].index(row.day)
        at = [_without(result, row.robot, k, day, one) for k in range(count)]
        result.verified[row.file] = verified(one, np.array(at))


def _without(result: Pooled, robot: str, k: int, day: int, one: Measured) -> float:
    """Pooled size of a robot's effect on a day without the share of one recording."""
    path = result.courses[robot, k]
    if not result.has(robot, k) or not path.variances[day] > 0.0:
        return 0.0
    total = 1.0 / path.variances[day]
    share = min(1.0 / (one.variances[k] + result.spreads[k][0] ** 2), total)
    if share > 0.99 * total:  # the only recording of the effect
        return float(path.sizes[day])
    return float((total * path.sizes[day] - share * one.sizes[k]) / (total - share))


def verified(one: Measured, sizes: np.ndarray) -> Verified:
    """Errors of a recording with given sizes, (K,), by the linearisation at its own ones."""
    by = sizes - one.at
    power = one.power + 2.0 * one.slope @ by + one.gram @ by @ by
    power, count = np.maximum(power, 0.0), np.maximum(one.count, 1)
    noise = is_noise(power, count)
    each = zip(np.sqrt(one.before / count), np.sqrt(power / count), noise, strict=True)
    explained = all(ok or evidence.closed(a, b) >= LIMITS.most for a, b, ok in each)
    total = count.sum()
    return Verified(
        float(np.sqrt(one.before.sum() / total)), float(np.sqrt(power.sum() / total)), explained
    )


def unexplained(
    rows: Sequence[Recording],
    measured: Mapping[str, Verified],
    done: Collection[tuple[str, str]],
    share: float,
) -> dict[str, str]:
    """Day of each robot with the largest errors that the pooled sizes do not explain.

    Args:
        rows: Recordings, sorted by robot and day.
        measured: Verified recordings by file.
        done: Robots and days that have been searched.
        share: Share of a day's recordings with such errors above which the day counts.
    """
    loudest: dict[str, tuple[float, str]] = {}
    for (robot, day), each in by_day(rows).items():
        errors = [measured[row.file].after for row in each if not measured[row.file].explained]
        if len(errors) > share * len(each) and (robot, day) not in done:
            loudest[robot] = max(loudest.get(robot, (0.0, "")), (float(np.median(errors)), day))
    return {robot: day for robot, (_, day) in loudest.items()}
