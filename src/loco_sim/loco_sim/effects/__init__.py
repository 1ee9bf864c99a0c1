# SPDX-License-Identifier: Apache-2.0
"""Registry of named effects; importing this package registers all of them."""

import importlib
import pkgutil

from .base import EFFECTS, Effect, applicable, from_list, make, names, to_list
from .identity import Identity, LookAlike, Prior

__all__ = [
    "EFFECTS",
    "Effect",
    "Identity",
    "LookAlike",
    "Prior",
    "applicable",
    "from_list",
    "make",
    "names",
    "to_list",
]

for _module in sorted(m.name for m in pkgutil.iter_modules([f"{__path__[0]}/catalogue"])):
    importlib.import_module(f"{__name__}.catalogue.{_module}")  # registers its effects
