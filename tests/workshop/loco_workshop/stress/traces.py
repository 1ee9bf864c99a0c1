# SPDX-License-Identifier: Apache-2.0
"""Check for leftovers of a run: processes, shared memory, damaged bags."""

from __future__ import annotations

import os
import shutil
import time
from collections.abc import Iterable
from dataclasses import dataclass, field
from pathlib import Path

from loco_bringup.bag.reader import Bag
from loco_bringup.bag.recover import recover
from loco_bringup.graph import shm
from loco_control.exceptions import LocoError

TAG = "LOCO_CHAOS"  # environment variable that all processes of a cell inherit
_PATIENCE = 30.0  # longest wall time until unsupervised processes have ended [s]


@dataclass
class Traces:
    """Leftovers of the runs of a cell.

    Attributes:
        bags: Number of checked runs.
        whole: Number of bags that are complete or were recovered.
        orphans: Number of processes that survived their run.
        segments: Number of shared-memory files that survived their run.
        notes: Faults, one line each.
        opened: Shared-memory files that the processes of the newest run had open.
    """

    bags: int = 0
    whole: int = 0
    orphans: int = 0
    segments: int = 0
    notes: list[str] = field(default_factory=list)
    opened: set[str] = field(default_factory=set)

    @property
    def clean(self) -> bool:
        """Whether there are no leftovers and every bag is complete."""
        return self.bags == self.whole and not self.orphans and not self.segments

    def look(self, folder: Path, opened: set[str], patience: float = _PATIENCE) -> Bag | None:
        """Check the leftovers of a run that has ended.

        Args:
            folder: Folder of its bag.
            opened: Shared-memory files that its processes had open.
            patience: Longest wall time until its processes have ended [s].

        Returns:
            The bag, or its recovered copy; None if there is no readable bag.
        """
        end = time.monotonic() + patience
        while (left := tagged()) and time.monotonic() < end:
            time.sleep(0.05)
        self.orphans += len(left)
        dead = {str(path) for path in shm.leftovers()}
        orphaned = {name for name in dead if _stem(name) in opened}
        self.segments += len(orphaned)
        if left or orphaned:
            self.notes.append(f"{folder.name}: left {sorted(left)} {sorted(orphaned)}")
        return self._whole(folder)

    def _whole(self, folder: Path) -> Bag | None:
        self.bags += 1
        recovered = folder.with_name(f"{folder.name}_recovered")
        shutil.rmtree(recovered, ignore_errors=True)
        try:
            bag = Bag(recover(folder).folder or folder)
            bag.messages("/events")
        except LocoError as error:
            self.notes.append(f"{folder.name}: {error}")
            return None
        self.whole += 1
        return bag


def tagged() -> set[int]:
    """Pids of the processes of the current cell, without this process."""
    tag = f"{TAG}={os.environ.get(TAG, '')}".encode()
    pids = set()
    for pid in filter(str.isdigit, os.listdir("/proc")):
        try:
            environment = Path(f"/proc/{pid}/environ").read_bytes()
        except OSError:
            continue
        if tag in environment.split(b"\0") and int(pid) != os.getpid():
            pids.add(int(pid))
    return pids


def opened_by(pids: Iterable[int]) -> set[str]:
    """Names of shared-memory files that processes have open, without suffixes of locks."""
    opened = set()
    for pid in pids:
        for fd in Path(f"/proc/{pid}/fd").glob("*"):
            try:
                target = os.readlink(fd)
            except OSError:
                continue  # closed in the meantime
            if target.startswith(f"{shm.SHM}/"):
                opened.add(_stem(target))
    return opened


def _stem(name: str) -> str:
    return name.removesuffix("_el").removesuffix("_sl")
