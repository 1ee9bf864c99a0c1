# SPDX-License-Identifier: Apache-2.0
"""The values that a node reports on /diagnostics, and the limits beyond which it warns."""

from __future__ import annotations

import os
import resource
import time
from dataclasses import dataclass, fields
from typing import Any

from ..params import Params, parameter

OK, WARN, ERROR = b"\0", b"\1", b"\2"  # levels of DiagnosticStatus
_PAGE = resource.getpagesize()


def _limits(warning: float, error: float, doc: str, unit: str = "-", high: float = 1e6) -> Any:
    return parameter((warning, error), f"{doc}: warning, error", unit, 0.0, high)


@dataclass(frozen=True)
class HealthParams(Params):
    """Limits of the values on /diagnostics for warning and error; 0 for no limit."""

    silence: tuple[float, ...] = _limits(2.0, 10.0, "wall time since the last tick", "s")
    period_max_ms: tuple[float, ...] = _limits(
        0.0, 0.0, "longest wall time between two ticks", "ms"
    )
    cpu_percent: tuple[float, ...] = _limits(0.0, 0.0, "time on the processor, of one core", "%")
    late_share: tuple[float, ...] = _limits(
        0.05, 0.5, "realtime: share of ticks without a new command", high=1.0
    )
    stale: tuple[float, ...] = _limits(0.0, 0.0, "messages of old ticks since the last report")
    rejected: tuple[float, ...] = _limits(1.0, 0.0, "commands refused since the last report")
    refused: tuple[float, ...] = _limits(1.0, 0.0, "other messages refused since the last report")
    dropped: tuple[float, ...] = _limits(1.0, 0.0, "messages lost so far", high=1e9)
    slower: tuple[float, ...] = _limits(0.0, 0.0, "smallest real-time factor", high=1e3)


def judge(params: HealthParams, values: dict[str, Any]) -> tuple[bytes, str]:
    """Diagnostic level and message for the values of a report.

    Args:
        params: The limits.
        values: Values by name of their limit; the limit of ``real_time_factor`` is ``slower``.
    """
    level, messages = OK, []
    for f in fields(params):
        low = f.name == "slower"
        value = values.get("real_time_factor" if low else f.name)
        if value is None:
            continue
        for grade, limit in zip((ERROR, WARN), reversed(getattr(params, f.name)), strict=True):
            if limit and (value < limit if low else value >= limit):
                level = max(level, grade)
                sign = "below" if low else "reaches"
                messages.append(
                    f"{'real_time_factor' if low else f.name} {value:.4g} {sign} {limit:g}"
                )
                break
    return level, "; ".join(messages) or "running"


class PeriodMeter:
    """Mean and largest wall time between ticks since the last summary."""

    def __init__(self) -> None:
        self._last = 0.0
        self._reset()

    def _reset(self) -> None:
        self._count, self._sum, self._max = 0, 0.0, 0.0

    def mark(self) -> None:
        """Record a tick at the current time."""
        time_now = time.perf_counter()
        if self._last:
            period = time_now - self._last
            self._count += 1
            self._sum += period
            self._max = max(self._max, period)
        self._last = time_now

    @property
    def silence(self) -> float | None:
        """Wall time since the last tick [s], None before the first."""
        return time.perf_counter() - self._last if self._last else None

    def summary(self) -> dict[str, Any]:
        """Statistics since the last call."""
        mean = self._sum / self._count if self._count else 0.0
        values = {
            "ticks": self._count,
            "period_mean_ms": mean * 1e3,
            "period_max_ms": self._max * 1e3,
        }
        self._reset()
        return values


class UsageMeter:
    """Processor time and memory of this process, and the wall time between two reports."""

    def __init__(self) -> None:
        self._wall, self._cpu = time.perf_counter(), time.process_time()

    def summary(self) -> dict[str, Any]:
        """Statistics since the last call."""
        wall, cpu = time.perf_counter(), time.process_time()
        span, used = wall - self._wall, cpu - self._cpu
        self._wall, self._cpu = wall, cpu
        with open("/proc/self/statm") as file:
            resident = int(file.read().split()[1]) * _PAGE
        return {
            "pid": os.getpid(),
            "span_s": span,
            "cpu_percent": 100.0 * used / span if span > 0.0 else 0.0,
            "memory_mb": resident / 1e6,
        }
