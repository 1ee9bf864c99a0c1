# SPDX-License-Identifier: Apache-2.0
"""Find and remove files that killed Fast DDS processes left in /dev/shm.

A file is a leftover if it belongs to this user, no visible process has it or its lock open,
and the lock is free: the lock also covers processes that are not visible, such as those of
another container. The port of a reader must also not be mapped. A segment may be mapped, since
readers of a dead writer keep their mapping. Standard library only, because the guard uses it.
"""

from __future__ import annotations

import contextlib
import fcntl
import os
import re
import time
from collections.abc import Iterable, Iterator
from pathlib import Path

SHM = Path("/dev/shm")
_TIMEOUT = 2.0  # wall time to wait for another process that cleans [s]
# fastrtps_HEX and fastrtps_portN with their locks _el (exclusive) and _sl (shared), and
# the semaphore of a port.
_NAME = re.compile(r"(?:sem\.)?(fastrtps_(?:port\d+|[0-9a-f]{16}))(?:_el|_sl|_mutex)?$")
_LOCKS = ("_el", "_sl")


def leftovers(folder: Path = SHM) -> list[Path]:
    """Files of Fast DDS in a folder whose owners are dead, sorted."""
    groups: dict[str, list[Path]] = {}
    for path in folder.iterdir() if folder.is_dir() else ():
        match = _NAME.match(path.name)
        if match and _is_ours(path):
            groups.setdefault(match[1], []).append(path)
    # The files were listed before the open files: a live owner has had its file open since then.
    groups = _without(groups, _open_files(folder)) if groups else {}
    unlocked = {
        k: v
        for k, v in groups.items()
        if "port" in k or not any(p.name.endswith(_LOCKS) for p in v)
    }
    if unlocked:
        mapped = unlocked.keys() - _without(unlocked, _mapped_files(folder)).keys()
        groups = {k: v for k, v in groups.items() if k not in mapped}
    dead = [paths for paths in groups.values() if _is_free(paths)]
    return sorted(path for paths in dead for path in paths)


def clean(folder: Path = SHM) -> tuple[int, int]:
    """Remove the leftovers; one process cleans at a time, since testing a lock acquires it.

    Returns:
        Number of removed files, and their size [bytes].
    """
    files = size = 0
    with _turn(folder):
        for path in leftovers(folder):
            try:
                held = path.stat().st_size
                path.unlink()
            except OSError:
                continue
            files, size = files + 1, size + held
    return files, size


@contextlib.contextmanager
def _turn(folder: Path) -> Iterator[None]:
    """Lock for cleaning; waits for `_TIMEOUT` at most, since any user can hold the lock."""
    try:
        handle = os.open(folder, os.O_RDONLY | os.O_CLOEXEC)
    except OSError:  # the folder does not exist
        yield
        return
    try:
        end = time.monotonic() + _TIMEOUT
        while not _is_locked(handle) and time.monotonic() < end:
            time.sleep(0.01)
        yield
    finally:
        os.close(handle)


def _is_locked(handle: int) -> bool:
    try:
        fcntl.flock(handle, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except OSError:
        return False
    return True


def _is_ours(path: Path) -> bool:
    try:
        return path.stat().st_uid == os.getuid()
    except OSError:
        return False


def _without(groups: dict[str, list[Path]], used: set[str]) -> dict[str, list[Path]]:
    """Groups without a file in `used`."""
    return {k: v for k, v in groups.items() if not any(str(p) in used for p in v)}


def _is_free(paths: list[Path]) -> bool:
    """Whether no process holds a lock of the group.

    A group of one semaphore may belong to a port being created, so it counts as in use.
    """
    if all(path.name.startswith("sem.") for path in paths):
        return False
    for path in paths:
        if not path.name.endswith(_LOCKS):
            continue
        try:
            with open(path, "rb") as file:
                fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            return False
    return True


def _open_files(folder: Path) -> set[str]:
    """Files of a folder that a process has open."""
    files = set()
    for fds in _each("fd"):
        try:
            names = os.listdir(fds)
        except OSError:
            continue
        for name in names:
            try:
                files.add(os.readlink(f"{fds}/{name}"))
            except OSError:
                continue
    return {name for name in files if name.startswith(f"{folder}/")}


def _mapped_files(folder: Path) -> set[str]:
    """Files of a folder that a process has mapped."""
    files = set()
    for maps in _each("maps"):
        try:
            with open(maps) as file:
                files |= {
                    line.split(maxsplit=5)[5].strip() for line in file if f"{folder}/" in line
                }
        except (OSError, IndexError):
            continue
    return files


def _each(what: str) -> Iterable[str]:
    return (f"/proc/{pid}/{what}" for pid in os.listdir("/proc") if pid.isdigit())


if __name__ == "__main__":
    clean()
