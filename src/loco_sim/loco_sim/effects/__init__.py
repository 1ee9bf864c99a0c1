# SPDX-License-Identifier: Apache-2.0
"""Registry of named effects; importing this package registers all of them."""

from . import delay, faults, noise, payload, push  # noqa: F401  (registers)
from .base import EFFECTS, Effect, from_list, make, names, to_list

__all__ = ["EFFECTS", "Effect", "from_list", "make", "names", "to_list"]
