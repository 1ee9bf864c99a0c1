# SPDX-License-Identifier: Apache-2.0
"""Names of the physics engines and the default engine; imports no engine."""

from __future__ import annotations

import functools
import importlib.util
import os

from loco_control.exceptions import ParameterError

ENGINES = ("pybullet", "mujoco")


@functools.cache  # cached: searching for a package is slow
def installed() -> tuple[str, ...]:
    """Names of the engines that are installed, in the order of `ENGINES`."""
    return tuple(name for name in ENGINES if importlib.util.find_spec(name))


def require(engine: str) -> None:
    """Raise `ParameterError` when an engine of `ENGINES` is not installed."""
    if engine not in installed():
        available = " and ".join(installed())
        raise ParameterError(
            f"sim.engine is {engine!r}, which is not installed; installed: {available or 'none'}"
        )


def default_engine() -> str:
    """Default engine of robots and experiments.

    The value of the environment variable ``LOCO_ENGINE`` (set by `loco … --engine`), else PyBullet
    if it is installed, else MuJoCo.
    """
    return os.environ.get("LOCO_ENGINE") or (installed() or ENGINES)[0]
