# SPDX-License-Identifier: Apache-2.0
"""Registry of named effects; importing this package registers all of them."""

from . import catalogue  # noqa: F401  (registers the effects)
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
