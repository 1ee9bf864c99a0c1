# SPDX-License-Identifier: Apache-2.0
"""Measurement of the compilation time of a run's kernels."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager

from numba.core import event


class _Listener(event.Listener):
    """Processor time for compiling kernels [s], as in the first run after installation.

    Numba's own `TimingListener` measures wall time, which includes other processes.
    """

    def __init__(self) -> None:
        self.seconds, self._depth, self._began = 0.0, 0, 0.0

    def on_start(self, event: event.Event) -> None:
        if self._depth == 0:
            self._began = time.process_time()
        self._depth += 1  # compiling a kernel compiles the kernels that it calls

    def on_end(self, event: event.Event) -> None:
        self._depth -= 1
        if self._depth == 0:
            self.seconds += time.process_time() - self._began


@contextmanager
def compiling() -> Iterator[_Listener]:
    """Measure the compilation time of kernels in the block, in `seconds` of the result."""
    listener = _Listener()
    with event.install_listener("numba:compile", listener):
        yield listener
