# SPDX-License-Identifier: Apache-2.0
"""`loco recover`: copy the readable part of a damaged bag and report what is lost."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from loco_control.exceptions import BagError, LocoError, MissingFileError, ParameterError
from loco_control.files import whole_folder
from loco_control.reading import parse_yaml

from . import progress as bag_progress
from .mcap_chunk import Records
from .mcap_file import McapFile
from .parts import Information, information, mcap_paths, missing, numbered
from .salvage import Salvager
from .writer import LIBRARY, BagWriter

_RUN_FILES = ("experiment.yaml", "params.yaml", "weights.npz")  # files of a run beside its bag


@dataclass
class Recovery:
    """Recovered and lost parts of a bag.

    Attributes:
        folder: The new bag; None if the old one is undamaged.
        messages: Number of recovered messages.
        chunks: Number of undamaged chunks.
        seconds: Simulated time from the first recovered message to the last [s].
        lost: Number of lost messages; None if unknown.
        lost_seconds: Simulated time without messages [s]; None if unknown.
        at_least: Whether more may be lost, since the end of the recording is unknown.
        notes: Places of the damage, one line each.
    """

    folder: Path | None
    messages: int
    chunks: int
    seconds: float = 0.0
    lost: int | None = 0
    lost_seconds: float | None = 0.0
    at_least: bool = False
    notes: list[str] = field(default_factory=list)

    def __str__(self) -> str:
        if self.folder is None:
            return f"whole: {self.messages} messages in {self.chunks} chunks, nothing to recover"
        content = f"{self.messages} messages in {self.chunks} chunks, {self.seconds:.3f} s"
        prefix = "at least " if self.at_least else ""
        lost = "an unknown number of" if self.lost is None else f"{prefix}{self.lost}"
        time = "unknown" if self.lost_seconds is None else f"{prefix}{self.lost_seconds:.3f} s"
        return f"recovered {content}: {self.folder}; lost {lost} messages, {time}"


def recover(path: str | Path, out: str | Path | None = None) -> Recovery:
    """Copy every undamaged chunk of a bag into a new bag, split at the same places.

    The new folder appears only when it is complete.

    Args:
        path: Bag folder or ``.mcap`` file.
        out: New folder; default the old one's name with ``_recovered``.

    Raises:
        MissingFileError: There is no such bag.
        BagError: The bag has no readable part, or the disk has too little space.
        ParameterError: `out` exists.
    """
    path = Path(path)
    files = numbered(path) if path.is_dir() else mcap_paths(path)
    salvagers = [Salvager(file) for file in files]
    salvages = [salvager.found for salvager in salvagers]
    chunks = sum(len(salvage.blocks) for salvage in salvages)
    if _is_whole(path, salvagers):
        messages = sum(s.statistics.message_count for s in salvages if s.statistics)
        return Recovery(None, messages, chunks)
    old = path if path.is_dir() else path.with_suffix("")
    target = Path(out) if out else old.with_name(f"{old.resolve().name}_recovered")
    if target.exists():
        raise ParameterError(f"{target} exists already; name another folder with --out")
    if not chunks and not any(salvage.loose for salvage in salvages):
        size = sum(salvage.size for salvage in salvages)
        raise BagError(f"{path}: no whole chunk among {size} bytes; nothing to recover")
    absent = _lacking(files) if path.is_dir() else []
    return _Copy(salvagers, files, target, absent).run()


def _is_whole(path: Path, salvagers: list[Salvager]) -> bool:
    if any(s.found.lost or s.found.statistics is None for s in salvagers):
        return False
    try:
        files = [McapFile(file).path for file in mcap_paths(path)]
    except (BagError, MissingFileError):
        return False
    return len(files) == len(salvagers) and (files[0].parent / "metadata.yaml").is_file()


class _Copy:
    """Writer of the new bag, with counts of recovered and lost messages."""

    def __init__(
        self, salvagers: list[Salvager], files: list[Path], target: Path, missing: list[str]
    ):
        self._salvagers, self._files, self._target = salvagers, files, target
        self._lacks = missing  # missing files of the bag
        self._folder = files[0].parent
        self._lost = [item for salvager in salvagers for item in salvager.found.lost]
        self._spans: list[tuple[int, int]] = []  # times of each chunk [ns]
        self._foreign: Counter[int] = Counter()  # messages of channels without a definition
        self._written = 0
        self._topics: set[str] = set()  # topics of the new bag

    def run(self) -> Recovery:
        """Write the bag beside the target, then move it into place."""
        try:
            with whole_folder(self._target) as folder:
                self._write(folder)
        except OSError as error:
            raise BagError(f"no bag can be written at {self._target}: {error}") from None
        return self._recovery()

    def _write(self, folder: Path) -> None:
        custom = dict(_old_metadata(self._files).get("custom_data") or {})
        for salvager in self._salvagers:
            custom |= salvager.found.metadata.get(LIBRARY) or {}
        writer = BagWriter(folder, {str(k): str(v) for k, v in custom.items()})
        inside: set[str] = set()
        for salvager in self._salvagers:
            writer.split()
            salvage = salvager.found
            topics = self._announce(salvager, writer)
            for chunk in salvage.blocks:
                self._copy(salvager.records(chunk), topics, writer)
            if salvage.loose and not salvage.blocks:
                self._copy(salvager.loose(), topics, writer)
            for file in salvage.attachments:
                writer.attach(file.name, file.data, file.media_type)
                inside.add(file.name)
        for path in (self._folder / name for name in _RUN_FILES):
            if path.is_file() and path.name not in inside:
                writer.attach(path.name, path.read_bytes(), "application/octet-stream")
        writer.custom["recovered_from"] = (
            self._files[0].name if len(self._files) == 1 else self._folder.name
        )
        writer.close()
        if writer.failed:
            raise BagError(f"the recovered bag could not be written: {writer.failed}")

    def _announce(self, salvager: Salvager, writer: BagWriter) -> dict[int, str]:
        """Topic by channel of a file, for channels with a known message type."""
        topics: dict[int, str] = {}
        for number, channel in sorted(salvager.found.channels.items()):
            schema = salvager.found.schemas.get(channel.schema_id)
            if schema is None:
                continue
            if channel.topic not in self._topics:
                self._topics.add(channel.topic)
                hash_ = channel.metadata.get("topic_type_hash", "")
                qos = _profiles(channel.metadata.get("offered_qos_profiles", ""))
                text = schema.data.decode(errors="replace")
                writer.add_topic(channel.topic, schema.name, text, hash_, qos)
            topics[number] = channel.topic
        return topics

    def _copy(self, records: Records, topics: dict[int, str], writer: BagWriter) -> None:
        heads = records.heads
        if len(heads):
            times = heads["time"].clip(0)
            self._spans.append((int(times.min()), int(times.max())))
        rows = zip(heads.tolist(), records.starts.tolist(), records.stops.tolist(), strict=True)
        for (channel, sequence, time, publish), start, stop in rows:
            if time < 0:  # counted by the salvager already
                continue
            if channel in topics:
                data = records.data[start:stop]
                sent = publish if publish >= 0 else time
                writer.write(topics[channel], data, time, sequence, sent)
                self._written += 1
            else:
                self._foreign[channel] += 1

    def _recovery(self) -> Recovery:
        spans = np.array(self._spans or [(0, 0)], dtype=np.int64)
        seconds = (spans[:, 1].max() - spans[:, 0].min()) / 1e9
        lost, lost_seconds = self._losses(int(spans[:, 0].min()), int(spans[:, 1].max()))
        several = len(self._files) > 1
        notes = [*_unread_metadata(self._folder)]
        notes += [f"{name!r:.80} is missing" for name in self._lacks]
        notes += [(f"{file.name}: " if several else "") + str(item)
                  for file, s in zip(self._files, self._salvagers, strict=True)
                  for item in s.found.lost]  # fmt: skip
        notes += [f"{n} messages of channel {c}, which nothing describes"
                  for c, n in self._foreign.items()]  # fmt: skip
        chunks = sum(len(s.found.blocks) for s in self._salvagers)
        truncated = [item.stop == s.found.size for s in self._salvagers for item in s.found.lost]
        at_least = (any(truncated) or bool(self._lacks)) and self._expected() is None
        return Recovery(
            self._target, self._written, chunks, seconds, lost, lost_seconds, at_least, notes
        )

    def _losses(self, first: int, last: int) -> tuple[int | None, float | None]:
        """Number of lost messages and time without messages [s], from the sources that exist."""
        losses = [item for item in self._lost if item.content]
        counted = [item.messages for item in losses]
        expected = self._expected()
        if expected:
            count, start, end = expected
            lost: int | None = max(0, count - self._written)
        else:
            start, end = first, last
            lost = None if None in counted else sum(c for c in counted if c is not None)
            lost = lost if lost is None else lost + sum(self._foreign.values())
        spans = [item.times for item in losses]
        if not expected and (None in spans or not losses):
            complete = all(s.found.statistics for s in self._salvagers)
            return lost, None if losses or not complete else 0.0
        inner = sum(s[1] - s[0] for s in spans if s and first <= s[0] and s[1] <= last)
        ranges = [s for s in spans if s] + [(start, end)]
        outer = max(0, first - min(s[0] for s in ranges)) + max(0, max(s[1] for s in ranges) - last)
        return lost, (inner + outer) / 1e9

    def _expected(self) -> tuple[int, int, int] | None:
        """Number of recorded messages, times of the first and last [ns]; None if unknown."""
        statistics = [s.found.statistics for s in self._salvagers]
        if all(statistics) and not self._lacks:
            each = [s for s in statistics if s and s.message_count] or statistics[:1]
            count = sum(s.message_count for s in each)
            first = min(s.message_start_time for s in each)
            return count, first, max(s.message_end_time for s in each)
        if len(self._files) < len(list(self._folder.glob("*.mcap"))):
            return None  # the sources below describe the whole bag
        first = min((s[0] for s in self._spans), default=0)
        state = bag_progress.read(self._folder)
        if state:
            return state[0], first, state[1]
        old = _old_metadata(self._files)
        count = old.get("message_count", 0)
        if not count:
            return None
        try:
            if not all(file["message_count"] for file in old["files"]):
                return None  # the recorder was killed: no count of the last file
            start = int(old["starting_time"]["nanoseconds_since_epoch"])
            return int(count), start, start + int(old["duration"]["nanoseconds"])
        except (KeyError, TypeError, ValueError):
            return None


def _lacking(files: list[Path]) -> list[str]:
    """Missing files: named in ``metadata.yaml``, or a gap in the numbered series."""
    named = _old_metadata(files).get("relative_file_paths", [])
    present = {file.name for file in files}
    return [name for name in dict.fromkeys([*named, *missing(files)]) if name not in present]


def _old_metadata(files: list[Path]) -> Information:
    """Contents of ``metadata.yaml``; empty if it is unreadable or describes other files."""
    try:
        old = information(files[0].parent)
    except LocoError:
        return {}
    return old if {file.name for file in files} <= set(old.get("relative_file_paths", ())) else {}


def _unread_metadata(folder: Path) -> list[str]:
    """A note with the reason if ``metadata.yaml`` exists and cannot be read."""
    try:
        information(folder)
    except MissingFileError:
        return []
    except LocoError as error:
        return [f"nothing is taken from {error}"]
    return []


def _profiles(text: str) -> list[dict]:
    try:
        qos = parse_yaml(text, "offered QoS")
    except LocoError:
        return []
    return qos if isinstance(qos, list) else []
