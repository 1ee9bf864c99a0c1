# SPDX-License-Identifier: Apache-2.0
"""The state of a recording, in a file that outlives the recorder.

The file is mapped memory: telling costs no system call, and the system writes
it even when the process is killed. So `loco recover` can say what a killed
recorder had received and not written yet.
"""

from __future__ import annotations

import contextlib
import mmap
import os
import struct
from pathlib import Path

NAME = "recording.progress"
_STATE = struct.Struct("<QqQ")  # messages received, newest time [ns], 1 once told
_SIZE = 4096


class Progress:
    """Tells how many messages came; the file is gone when the bag is whole.

    Args:
        folder: Folder of the bag.
    """

    def __init__(self, folder: Path):
        self._path = folder / NAME
        self._memory: mmap.mmap | None = None
        with contextlib.suppress(OSError), open(self._path, "w+b") as file:
            os.posix_fallocate(file.fileno(), 0, _SIZE)  # a hole on a full disk would be fatal
            self._memory = mmap.mmap(file.fileno(), _SIZE)

    def tell(self, count: int, time: int) -> None:
        """So many messages came, the newest at this time [ns]."""
        if self._memory is not None:
            _STATE.pack_into(self._memory, 0, count, time, 1)

    def done(self) -> None:
        """The bag is whole: the file is not needed."""
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
