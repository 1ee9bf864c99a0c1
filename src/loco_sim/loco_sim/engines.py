# SPDX-License-Identifier: Apache-2.0
"""Names of the physics engines, and which of them is the default; loads nothing else."""

from __future__ import annotations

import functools
import importlib.util
import os

from loco_control.exceptions import ParameterError

ENGINES = ("pybullet", "mujoco")


@functools.cache  # looking for a package takes longer than making parameters
def installed() -> tuple[str, ...]:
    """Names of the engines that are installed, in the order of `ENGINES`."""
    return tuple(name for name in ENGINES if importlib.util.find_spec(name))


def require(engine: str) -> None:
    """Raise `ParameterError` when an engine of `ENGINES` is not installed."""
    if engine not in installed():
        there = " and ".join(installed())
        raise ParameterError(
            f"sim.engine is {engine!r}, which is not installed; installed: {there or 'none'}"
        )


def default_engine() -> str:
    """Engine of robots and experiments that name none.

    It is what the environment variable ``LOCO_ENGINE`` says (`loco … --engine` sets it), else
    PyBullet where it is installed, else MuJoCo.
    """
    return os.environ.get("LOCO_ENGINE") or (installed() or ENGINES)[0]
