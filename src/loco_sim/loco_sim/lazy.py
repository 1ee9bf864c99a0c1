# SPDX-License-Identifier: Apache-2.0
"""Lazy loading of modules at their first use.

Importing compiled kernels takes a second. Commands that only read an experiment or print a
list do not need them.
"""

from __future__ import annotations

import importlib.util
import sys
from types import ModuleType


def module(name: str) -> ModuleType:
    """A module that is loaded at its first use; the module itself if it is already loaded.

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
    loaded = importlib.util.module_from_spec(spec)
    sys.modules[name] = loaded
    spec.loader.exec_module(loaded)
    return loaded
