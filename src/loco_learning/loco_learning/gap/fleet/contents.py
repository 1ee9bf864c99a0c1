# SPDX-License-Identifier: Apache-2.0
"""Contents of ``fleet.json``, and the table with a row for each recording."""

from __future__ import annotations

import math
from collections import Counter
from typing import Any

from ...plain import plain
from ..verdict.sensitivity import NORMAL
from .course import ABSENT
from .fleet import Fleet
from .pooling import Mean
from .terms import Term

FORMAT = 1


def contents(fleet: Fleet, robot: str, params: dict[str, Any]) -> dict[str, Any]:
    """Contents of ``fleet.json``.

    Args:
        fleet: The finished fleet.
        robot: The robot, as on the command line.
        params: Settings as plain values.
    """
    return plain(
        {
            "format": FORMAT,
            "robot": robot,
            "settings": params,
            "recordings": len(fleet.recordings),
            "effects": [_effect(fleet, k) for k in range(len(fleet.terms))],
            "robots": [_robot(fleet, name) for name in fleet.robots],
            "unexplained": [
                {"file": row.file, "robot": row.robot, "day": row.day,
                 "before": one.before, "after": one.after}
                for row in fleet.recordings
                if not (one := fleet.pooled.verified[row.file]).explained
            ],
            "skipped": [{"file": f, "reason": text} for f, text in sorted(fleet.skipped.items())],
        }
    )  # fmt: skip


def _effect(fleet: Fleet, k: int) -> dict[str, Any]:
    """An effect of the fleet: its size over all robots that have it."""
    term, pooled = fleet.terms[k], fleet.pooled
    days, robots = pooled.spreads[k]
    return {
        "effect": term.effect,
        "place": term.place,
        "parameter": term.parameter,
        "unit": term.unit,
        "name_probability": term.probability,
        "robots": [robot for robot in fleet.robots if pooled.has(robot, k)],
        **(_size(term, pooled.means[k]) if k in pooled.means else _unknown()),
        "spread_days": abs(term.size) * days,
        "spread_robots": abs(term.size) * robots,
        "model": term.spec,
    }


def _robot(fleet: Fleet, robot: str) -> dict[str, Any]:
    """A robot with its effects, and what its searches said."""
    robot_rows = [row for row in fleet.recordings if row.robot == robot]
    pooled, counts = fleet.pooled, Counter(row.day for row in robot_rows)
    return {
        "robot": robot,
        "recordings": len(robot_rows),
        "searches": [
            {"day": day, "verdict": one.verdict, "evidence": one.evidence}
            for day, one in fleet.searches.get(robot, {}).items()
        ],
        "effects": [_course(fleet, robot, k) for k in range(len(fleet.terms))],
        "days": [{"day": day, "recordings": counts[day]} for day in pooled.days[robot]],
        "unexplained": sum(not pooled.verified[row.file].explained for row in robot_rows),
    }


def _course(fleet: Fleet, robot: str, k: int) -> dict[str, Any]:
    """An effect in a robot: whether, since when, how large on each day."""
    term, pooled = fleet.terms[k], fleet.pooled
    path, days, has = pooled.courses[robot, k], pooled.days[robot], pooled.has(robot, k)
    last = max(range(len(days)), key=lambda d: (path.variances[d] > 0.0, d))
    changed = has and path.change is not None
    latest = Mean(float(path.sizes[last]), float(path.variances[last]))
    return {
        "effect": term.effect,
        "place": term.place,
        "has": has,
        "probability": path.present,
        "course": path.kind if has else ABSENT,
        "day": days[path.change] if changed else None,
        "day_probability": path.probability / path.present * path.date if changed else None,
        **(_size(term, latest) if has and path.kind != ABSENT else _unknown()),
        "unit": term.unit,
        "days": [
            {"day": day, **_size(term, one)}
            for day, one in zip(days, pooled.sizes[robot, k], strict=True)
        ],
    }


def _size(term: Term, one: Mean) -> dict[str, float]:
    """Size with its 95 % interval, in the unit of the effect."""
    value, width = term.size * one.value, abs(term.size) * NORMAL * math.sqrt(one.variance)
    return {"size": value, "low": value - width, "high": value + width}


def _unknown() -> dict[str, None]:
    return {"size": None, "low": None, "high": None}


def rows(fleet: Fleet) -> list[dict[str, Any]]:
    """A row for each recording, used or not: where it belongs, its errors and its sizes."""
    result = []
    for row in fleet.recordings:
        one, verified = fleet.measured[row.file], fleet.pooled.verified[row.file]
        line = {
            "file": row.file, "robot": row.robot, "day": row.day,
            "seconds": fleet.excitations[row.file].seconds,
            "searched": row.file in fleet.fitted,
            "before": verified.before, "after": verified.after, "explained": verified.explained,
        }  # fmt: skip
        for k, term in enumerate(fleet.terms):
            size = _size(term, Mean(float(one.sizes[k]), float(one.variances[k])))
            line |= {f"{term.key} {name} [{term.unit}]": value for name, value in size.items()}
        result.append(line)
    return plain(result)
