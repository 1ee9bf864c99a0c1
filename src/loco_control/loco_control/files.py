# SPDX-License-Identifier: Apache-2.0
"""Atomic writes of files and folders, and locks between the processes of this machine."""

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

_NAME = 100  # longest name of an abstract socket that is used unhashed [bytes]


def write_whole(path: str | Path, content: str | bytes | Callable[[BinaryIO], Any]) -> Path:
    """Write a file such that readers see its old content or its new one, never a part.

    The content is written to a temporary file in the same folder, flushed to the disk and renamed.
    A missing folder is created; after an error the old file is unchanged. The temporary file of a
    killed process is reused, and thereby removed, by the next write of the same file.

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
    """An empty file, locked by this process; waits while another process writes the same file."""
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
        os.close(handle)  # the previous owner of the lock has just renamed the file


@contextlib.contextmanager
def whole_folder(path: str | Path) -> Iterator[Path]:
    """Context of a folder whose content appears atomically when the block ends without an error.

    The block writes into an empty temporary folder on the same disk. If the target folder exists,
    new files replace files of the same name. After an error the target is unchanged, and parent
    folders created here are removed.

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
    """Refuse an unwritable folder, before a computation whose result belongs there.

    Args:
        folder: The folder; it need not exist, and is not created.

    Raises:
        ParameterError: No file can be created in it or in its nearest existing parent.
    """
    folder_path = Path(folder).absolute()
    try:
        while not _exists(folder_path):
            folder_path = folder_path.parent
        with tempfile.TemporaryFile(dir=folder_path) as file:
            file.write(b"x")
    except (OSError, ValueError) as error:
        # A ValueError is a null byte in the name; its message depends on the version of Python.
        system = isinstance(error, OSError)
        reason = error.strerror or error if system else "the name holds a null byte"
        raise ParameterError(
            f"nothing can be written in {cut(str(folder))!r}: {reason}; choose another --out"
        ) from None


def claim(folder: Path, *own_files: str) -> None:
    """Refuse a results folder that contains unrelated files or cannot be written.

    Args:
        folder: The folder; it need not exist, and is not created.
        own_files: Names of files by which earlier results of the same command are recognised; such
            results are replaced.

    Raises:
        ParameterError: The folder is a file, contains other files, or cannot be written.
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
    """Whether a file exists; unlike `Path.exists`, raises for names that no file can have."""
    try:
        path.stat()
    except FileNotFoundError:
        return False
    return True


@contextlib.contextmanager
def locked(name: str) -> Iterator[None]:
    """Context of a machine-wide lock, across users, that is released when its process ends.

    The lock is an abstract Unix socket and not a file, so nothing has to be cleaned up. It is valid
    within one network namespace, as is the traffic of ROS.

    Args:
        name: Name of the lock.

    Raises:
        BlockingIOError: Another process, or another part of this one, holds the lock.
        OSError: The system has no abstract Unix sockets.
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
