# SPDX-License-Identifier: Apache-2.0
"""Files and folders that exist whole or not at all."""

from __future__ import annotations

import contextlib
import os
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, BinaryIO


def write_whole(path: str | Path, content: str | bytes | Callable[[BinaryIO], Any]) -> Path:
    """Write a file such that readers see its old content or its new one, never a part.

    The content goes into a file beside it, is flushed to the disk, and then takes the name.
    The folder is made if it is missing; whatever goes wrong, the old file stays as it was.

    Args:
        path: The file.
        content: Text (written as UTF-8), bytes, or a function that writes into an open file.

    Returns:
        The path.

    Raises:
        OSError: The disk is full, or the folder cannot be written.
    """
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)
    part = path.with_name(f".{path.name}.{os.getpid()}.part")
    try:
        with open(part, "wb") as file:
            if callable(content):
                content(file)
            else:
                file.write(content.encode() if isinstance(content, str) else content)
            file.flush()
            os.fsync(file.fileno())
        part.replace(path)
    except BaseException:
        part.unlink(missing_ok=True)
        raise
    return path


@contextlib.contextmanager
def whole_folder(path: str | Path) -> Iterator[Path]:
    """A folder whose content appears at once, when the block ends without an error.

    The block writes into an empty folder of the same name elsewhere on the same disk. If the folder
    exists, the new files replace those of their names. After an error everything is as before,
    folders above included.

    Args:
        path: The folder.

    Raises:
        OSError: The folder cannot be written.
    """
    path = Path(path).absolute()
    above = [folder for folder in path.parents if not folder.exists()]
    path.parent.mkdir(parents=True, exist_ok=True)
    try:
        with tempfile.TemporaryDirectory(prefix=".loco-", dir=path.parent) as place:
            work = Path(place) / path.name
            work.mkdir()
            yield work
            if path.exists():
                for file in work.iterdir():
                    file.replace(path / file.name)
            else:
                work.rename(path)
    except BaseException:
        with contextlib.suppress(OSError):
            for folder in above:
                folder.rmdir()
        raise
