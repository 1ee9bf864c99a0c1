# SPDX-License-Identifier: Apache-2.0
"""Decorators of compiled functions that allocate nothing.

They are compiled without reference counting of arrays, which takes longer than the arithmetic of
a small robot, and divide as NumPy does. Arrays come from the caller.
"""

from __future__ import annotations

from numba import njit

kernel = njit(cache=True, error_model="numpy", _nrt=False)
inlined = njit(cache=True, error_model="numpy", _nrt=False, forceinline=True)
