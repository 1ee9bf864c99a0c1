# SPDX-License-Identifier: Apache-2.0
"""Files and folders that exist whole or not at all, and locks of this machine."""

from __future__ import annotations

import contextlib
import errno
import fcntl
import hashlib
import os
import socket
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, BinaryIO

from .exceptions import ParameterError, cut

_NAME = 100  # longest name of an abstract socket that is used as it is [bytes]


def write_whole(path: str | Path, content: str | bytes | Callable[[BinaryIO], Any]) -> Path:
    """Write a file such that readers see its old content or its new one, never a part.

    The content goes into a file beside it, is flushed to the disk, and then takes the name.
    The folder is made if it is missing; whatever goes wrong, the old file stays as it was. The file
    beside it that a killed process leaves is used and gone when the same is written again.

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
    part = path.with_name(f".{path.name}.part")
    with _is_unused(part) as file:
        try:
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


def _is_unused(path: Path) -> BinaryIO:
    """An empty file that this process alone has open; waits for others that write the same."""
    while True:
        handle = os.open(path, os.O_RDWR | os.O_CREAT | os.O_NOFOLLOW | os.O_CLOEXEC, 0o666)
        try:
            fcntl.flock(handle, fcntl.LOCK_EX)
            with contextlib.suppress(FileNotFoundError):
                if os.path.samestat(os.fstat(handle), os.lstat(path)):
                    os.ftruncate(handle, 0)
                    return os.fdopen(handle, "wb")
        except BaseException:
            os.close(handle)
            raise
        os.close(handle)  # whoever had it has just given it its name


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


def check_writable(folder: str | Path) -> None:
    """Refuse a folder in which nothing can be written, before work whose result goes there.

    Args:
        folder: The folder; it need not exist, and is not made.

    Raises:
        ParameterError: No file can be made in it or in the nearest folder above it.
    """
    folder_path = Path(folder).absolute()
    try:
        while not _exists(folder_path):
            folder_path = folder_path.parent
        with tempfile.TemporaryFile(dir=folder_path) as file:
            file.write(b"x")
    except (OSError, ValueError) as error:
        # A ValueError is a null byte in the name, for which Pythons have different words.
        system = isinstance(error, OSError)
        reason = error.strerror or error if system else "the name holds a null byte"
        raise ParameterError(
            f"nothing can be written in {cut(str(folder))!r}: {reason}; choose another --out"
        ) from None


def claim(folder: Path, *own_files: str) -> None:
    """Refuse a folder for results that holds something else or cannot be written.

    Args:
        folder: The folder; it need not exist, and is not made.
        own_files: Names of files of which earlier results of the same command have one; they are
            replaced.

    Raises:
        ParameterError: The folder is a file, holds other files, or nothing can be written in it.
    """
    if folder.exists() and not folder.is_dir():
        raise ParameterError(f"{folder} is a file, wanted is a folder")
    if (
        folder.is_dir()
        and any(folder.iterdir())
        and not any((folder / o).is_file() for o in own_files)
    ):
        raise ParameterError(f"{folder} holds other files; choose another --out")
    check_writable(folder)


def _exists(path: Path) -> bool:
    """Whether a file is there; `Path.exists` takes names that cannot be for missing ones."""
    try:
        path.stat()
    except FileNotFoundError:
        return False
    return True


@contextlib.contextmanager
def locked(name: str) -> Iterator[None]:
    """A lock of this machine: one process of all users has it at a time, and a killed one frees it.

    It is the name of an abstract Unix socket, and so of no file: nothing is left over, and it holds
    in one network namespace, as the traffic of ROS does.

    Args:
        name: Name of the lock.

    Raises:
        BlockingIOError: Another process, or another part of this one, has it.
        OSError: The system has no such sockets.
    """
    name = name if len(name.encode()) <= _NAME else hashlib.sha256(name.encode()).hexdigest()
    with socket.socket(socket.AF_UNIX, socket.SOCK_STREAM) as held:
        try:
            held.bind(f"\0loco/{name}")
        except OSError as error:
            if error.errno == errno.EADDRINUSE:
                raise BlockingIOError(error.errno, f"{name} is in use") from None
            raise
        yield
