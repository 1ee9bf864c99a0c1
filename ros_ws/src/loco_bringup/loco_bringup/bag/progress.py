# SPDX-License-Identifier: Apache-2.0
"""State of a recording in progress, in a file that survives a crash of the recorder.

The file is memory-mapped: an update costs no system call, and the system writes it
even if the process is killed. `loco recover` uses it to report messages that a killed
recorder had received but not written yet.
"""

from __future__ import annotations

import contextlib
import mmap
import os
import struct
from pathlib import Path

NAME = "recording.progress"
_STATE = struct.Struct("<QqQ")  # messages received, newest time [ns], 1 after the first update
_SIZE = 4096


class Progress:
    """Number of messages received so far, in a file that is deleted when the bag is complete.

    Args:
        folder: Folder of the bag.
    """

    def __init__(self, folder: Path):
        self._path = folder / NAME
        self._memory: mmap.mmap | None = None
        with contextlib.suppress(OSError), open(self._path, "w+b") as file:
            os.posix_fallocate(file.fileno(), 0, _SIZE)  # a hole on a full disk kills (SIGBUS)
            self._memory = mmap.mmap(file.fileno(), _SIZE)

    def tell(self, count: int, time: int) -> None:
        """Store the number of received messages and the time of the newest [ns]."""
        if self._memory is not None:
            _STATE.pack_into(self._memory, 0, count, time, 1)

    def done(self) -> None:
        """Delete the file, once the bag is complete."""
        if self._memory is not None:
            self._memory.close()
            self._memory = None
        with contextlib.suppress(OSError):
            self._path.unlink()


def read(folder: Path) -> tuple[int, int] | None:
    """Messages that a recorder had received, and the newest time [ns]; None if unknown."""
    try:
        count, time, mark = _STATE.unpack_from((folder / NAME).read_bytes())
    except (OSError, struct.error):
        return None
    return (count, time) if mark == 1 else None
