# SPDX-License-Identifier: Apache-2.0
"""`loco bench damage`: recovery of bags after truncation and after changed bytes."""

from __future__ import annotations

import hashlib
import shutil
import tempfile
import time
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np

from loco_bringup.bag.mcap_scan import HEAD
from loco_bringup.bag.reader import Bag
from loco_bringup.bag.recover import recover
from loco_bringup.bag.writer import BagWriter
from loco_bringup.record.order import Order
from loco_control.exceptions import LocoError
from loco_control.ros.messages.topics import topic

TRUNCATIONS, FLIPS = 300, 1000
_CHUNK = 8 * 1024  # chunk size [bytes], small for many chunks


def bench_damage(truncations: int = TRUNCATIONS, flips: int = FLIPS, seed: int = 0) -> list[dict]:
    """Truncate a bag at random bytes, change random bytes; read and recover each damaged copy.

    Returns:
        One row per kind of damage; ``chunks missed``, ``wrong data`` and ``tracebacks``
        must be zero.
    """
    rng = np.random.default_rng(seed)
    with tempfile.TemporaryDirectory() as folder:
        intact = sample(Path(folder) / "whole")
        trial = _Trial(intact, Path(folder))
        cuts = rng.integers(0, len(trial.data), truncations)
        for cut in cuts.tolist():
            trial.run("truncated", trial.data[:cut], lambda a, b, cut=cut: b <= cut)
        offsets, masks = rng.integers(0, len(trial.data), flips), rng.integers(1, 256, flips)
        for at, mask in zip(offsets.tolist(), masks.tolist(), strict=True):
            data = bytearray(trial.data)
            data[at] ^= mask
            trial.run("byte changed", bytes(data), lambda a, b, at=at: not a <= at < b)
    return [
        {"damage": kind, **{k: tally[k] for k in COLUMNS}, "slowest ms": trial.slowest[kind]}
        for kind, tally in trial.tallies.items()
    ]


HARM = ("chunks missed", "wrong data", "tracebacks")  # columns that must be zero
COLUMNS = ("files", "recovered", "clear message", *HARM)


def sample(folder: Path, ticks: int = 500) -> Path:
    """Write a bag of many small chunks, with messages of two topics and an attachment."""
    rng = np.random.default_rng(1)
    writer = BagWriter(folder, {"experiment": "sample"}, _CHUNK)
    names = ("robot_state", "trunk_torque")
    for name in names:
        writer.add_row("/" + name, topic(name))
    for tick in range(ticks):
        for name, size in zip(names, (632, 252), strict=True):
            values = rng.normal(size=size // 8).round(2)
            writer.write("/" + name, b"\x00\x01\x00\x00" + values.tobytes(), tick * 4_000_000)
    writer.attach("experiment.yaml", b"name: sample\n" + b"# filling\n" * 25)
    writer.close()
    return folder


class _Trial:
    """Test of reader and recovery on damaged copies of a bag, with counts."""

    def __init__(self, whole: Path, folder: Path):
        bag = Bag(whole)
        self._folder, self.data = folder, bag.path.read_bytes()
        self._file = folder / "damaged" / "damaged_0.mcap"
        self._file.parent.mkdir()
        self._messages = _messages(bag)
        self._chunks = []
        for chunk in bag.file.chunks:
            records = bag.file.records(chunk)
            prints = _prints(bag, records)
            self._chunks.append((chunk.start - HEAD.size, chunk.stop, prints))
        self.tallies: dict[str, Counter] = {}
        self.slowest: dict[str, float] = {}

    def run(self, kind: str, data: bytes, spared: Any) -> None:
        """Test one damaged file; ``spared(start, stop)`` is true for an undamaged chunk."""
        tally = self.tallies.setdefault(kind, Counter())
        tally["files"] += 1
        self._file.write_bytes(data)
        began = time.perf_counter()
        try:
            self._read(tally)
            self._recover(tally, spared)
        except Exception:
            tally["tracebacks"] += 1
        milliseconds = 1e3 * (time.perf_counter() - began)
        self.slowest[kind] = max(milliseconds, self.slowest.get(kind, 0.0))

    def _read(self, tally: Counter) -> None:
        """Check that a damaged file is either read correctly or reported as damaged."""
        try:
            tally["wrong data"] += _messages(Bag(self._file)) != self._messages
        except LocoError:
            pass

    def _recover(self, tally: Counter, spared: Any) -> None:
        out = self._folder / "out"
        expected = Counter()
        for start, stop, prints in self._chunks:
            if spared(start, stop):
                expected.update(prints)
        try:
            recovery = recover(self._file, out)
        except LocoError as error:
            tally["clear message"] += "\n" not in str(error)
            tally["chunks missed"] += bool(expected)
            return
        messages = _messages(Bag(out if recovery.folder else self._file))
        tally["recovered"] += 1
        tally["chunks missed"] += bool(expected - messages)
        tally["wrong data"] += bool(messages - self._messages)
        _remove(out)


def _messages(bag: Bag) -> Counter:
    """Hashes of all messages with their counts."""
    order = Order(bag, list(bag.topics))
    return Counter(_print(name, round((bag.start + t) * 1e9), data) for t, name, data in order)


def _prints(bag: Bag, records) -> Counter:
    rows = zip(records.heads.tolist(), records.starts.tolist(), records.stops.tolist(), strict=True)
    return Counter(
        _print(bag.summary.channels[c].topic, t, records.data[a:b]) for (c, _, t, _), a, b in rows
    )


def _print(name: str, t: int, data: bytes) -> bytes:
    return hashlib.blake2b(f"{name} {t} ".encode() + data, digest_size=8).digest()


def _remove(folder: Path) -> None:
    shutil.rmtree(folder, ignore_errors=True)
