# SPDX-License-Identifier: Apache-2.0
"""Tells how long the kernels of a run took to compile."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager

from numba.core import event


class _Listener(event.Listener):
    """Processor time that goes into compiling kernels [s], as in the first run after set-up.

    Numba's own `TimingListener` tells wall time, in which other processes have a share.
    """

    def __init__(self) -> None:
        self.seconds, self._depth, self._began = 0.0, 0, 0.0

    def on_start(self, event: event.Event) -> None:
        if self._depth == 0:
            self._began = time.process_time()
        self._depth += 1  # a kernel has those compiled that it calls

    def on_end(self, event: event.Event) -> None:
        self._depth -= 1
        if self._depth == 0:
            self.seconds += time.process_time() - self._began


@contextmanager
def compiling() -> Iterator[_Listener]:
    """Measure what kernels take to compile in the block; it grows in `seconds` of the result."""
    listener = _Listener()
    with event.install_listener("numba:compile", listener):
        yield listener
