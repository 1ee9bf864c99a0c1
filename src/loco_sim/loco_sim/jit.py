# SPDX-License-Identifier: Apache-2.0
"""Decorators of compiled functions, whose caches on disk are made anew if they cannot be read.

A cache names the classes of the tuples that a function is called with. After an update in which
such a class has moved, numba ends with an error where it should compile.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numba
from numba.core.caching import FunctionCache


class _Cache(FunctionCache):
    """Cache of a compiled function that is emptied if it names what no longer exists."""

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """The compiled function for a signature; None if it is not in the cache."""
        try:
            return super().load_overload(sig, target_context)
        except (ImportError, AttributeError):
            self.flush()
            return None


def njit(**options: Any) -> Callable[[Callable], Callable]:
    """As `numba.njit` with a cache; for functions that are called with tuples of loco.

    Args:
        options: Options of `numba.njit`.
    """

    def decorate(function: Callable) -> Callable:
        compiled = numba.njit(**options)(function)
        compiled._cache = _Cache(function)
        return compiled

    return decorate


# Kernels allocate nothing, as arrays come from the caller: they are compiled without reference
# counting, which takes longer than the arithmetic of a small robot. They divide as NumPy does.
kernel = njit(error_model="numpy", _nrt=False)
inlined = njit(error_model="numpy", _nrt=False, forceinline=True)
