# SPDX-License-Identifier: Apache-2.0
"""Modules that are loaded when something in them is used, and not before.

Compiled kernels cost a second to import. Whoever only reads an experiment or prints a
list never calls one.
"""

from __future__ import annotations

import importlib.util
import sys
from types import ModuleType


def module(name: str) -> ModuleType:
    """A module that loads itself at the first use; the module itself if it is loaded.

    Args:
        name: Full name, e.g. ``loco_sim.effects.reading_laws``.

    Raises:
        ModuleNotFoundError: There is no such module.
    """
    if name in sys.modules:
        return sys.modules[name]
    spec = importlib.util.find_spec(name)
    if spec is None or spec.loader is None:
        raise ModuleNotFoundError(f"there is no module {name}")
    spec.loader = importlib.util.LazyLoader(spec.loader)
    made = importlib.util.module_from_spec(spec)
    sys.modules[name] = made
    spec.loader.exec_module(made)
    return made
