# SPDX-License-Identifier: Apache-2.0
"""Read JointState topics as tracks: samples with their own time stamps."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field

import numpy as np

from loco_control.exceptions import BagError, LocoError, ParameterError
from loco_control.ros.messages.joint_codec import JointCodec, stamp_ns
from loco_learning.gap.importing.align import add_note
from loco_learning.gap.recordings.record import Doubt
from loco_learning.gap.recordings.tracks import Track

from ..bag.reader import Bag

FIELDS = ("position", "velocity", "effort")


@dataclass
class Layout:
    """Messages with the same joints in the same order and the same fields.

    Attributes:
        names: Joints in the order of the arrays.
        codec: Decoder of the messages.
        rows: Indices of the messages in their topic.
        values: Per message, arrays (n,) by field.
    """

    names: tuple[str, ...]
    codec: JointCodec
    rows: list[int] = field(default_factory=list)
    values: list[dict[str, np.ndarray]] = field(default_factory=list)


@dataclass(frozen=True)
class Messages:
    """Messages of a topic of JointState.

    Attributes:
        topic: Name of the topic.
        logged: Log times [ns], (T,).
        stamps: Header stamps [ns], (T,); all 0 without stamps.
        layouts: The messages by their joints and fields.
    """

    topic: str
    logged: np.ndarray
    stamps: np.ndarray
    layouts: list[Layout]


def read(bag: Bag, topic: str) -> Messages:
    """Messages of a topic.

    Args:
        bag: The recording.
        topic: Topic of JointState.

    Raises:
        BagError: Messages are damaged.
    """
    logged, data = bag.raw(topic)
    with _named(bag):
        groups = layouts(bag, topic, data)
        stamps = np.array([stamp_ns(message) for message in data], dtype=np.int64)
    return Messages(topic, logged, stamps, groups)


def tracks(
    bag: Bag, messages: Messages, roles: dict[str, str], notes: list[str], which: str = ""
) -> list[Track]:
    """Signals of a topic, one per joint and field of its messages.

    Several publishers may send different joints or fields on one topic.

    Args:
        bag: The recording.
        messages: Messages of the topic.
        roles: Roles of the signals by field.
        notes: List to which sentences on clocks and publishers are appended.
        which: Clock of the messages, as in `clock`.

    Raises:
        BagError: A joint occurs in messages with different joint lists, or stamps are damaged.
    """
    topic, stamps, logged = messages.topic, messages.stamps, messages.logged
    publishers: dict[frozenset[str], list[Layout]] = {}
    for layout in messages.layouts:
        publishers.setdefault(frozenset(layout.names), []).append(layout)
    result = []
    with _named(bag):
        if len(publishers) > 1:
            _check_publishers(bag, topic, publishers, notes)
        for group in publishers.values():
            rows = np.sort(np.concatenate([layout.rows for layout in group]))
            t = np.full(len(stamps), np.nan)
            t[rows] = clock(stamps[rows], logged[rows], topic, notes, which)
            result += _of_publisher(group, t, topic, roles)
    return result


@contextmanager
def _named(bag: Bag) -> Iterator[None]:
    """Errors are those of the bag, and name it."""
    try:
        yield
    except LocoError as error:
        text = str(error)
        raise BagError(text if bag.path.name in text else f"{bag.path.name}: {text}") from None


def layouts(bag: Bag, topic: str, data: list[bytes]) -> list[Layout]:
    """Messages of a topic grouped by layout, in the order of first occurrence.

    Raises:
        LocoError: The bytes are no JointState, or a field lacks values for some joints.
    """
    by_key: dict[tuple, Layout] = {}
    last: Layout | None = None
    for row, message in enumerate(data):
        values = last.codec.read_layout(message) if last else None
        if values is None:
            last = _layout(bag, topic, message, by_key)
            values = last.codec.read_layout(message)
        if values is None:  # other byte order, which the codec does not support
            decoded = bag.message(topic, message)
            arrays = {f: np.array(getattr(decoded, f), float) for f in FIELDS}
            values = {name: array for name, array in arrays.items() if len(array)}
        last.rows.append(row)
        last.values.append(values)
    return list(by_key.values())


def _layout(bag: Bag, topic: str, message: bytes, cache: dict[tuple, Layout]) -> Layout:
    decoded = bag.message(topic, message)
    names, count = tuple(decoded.name), len(decoded.name)
    if len(set(names)) < count:
        raise ParameterError(f"{topic} names a joint twice: {', '.join(names)}")
    fields = [f for f in FIELDS if len(getattr(decoded, f))]
    for name in fields:
        if len(getattr(decoded, name)) != count:
            raise ParameterError(
                f"{topic} must have {count} values in {name}, got {len(getattr(decoded, name))}"
            )
    key = names, tuple(fields), decoded.header.frame_id
    if key not in cache:
        cache[key] = Layout(names, JointCodec(names, topic, fields, decoded.header.frame_id))
    return cache[key]


def _check_publishers(
    bag: Bag, topic: str, publishers: dict[frozenset[str], list[Layout]], notes: list[str]
) -> None:
    """Check that no joint has two publishers, and append a note for each publisher.

    Raises:
        BagError: Two publishers send the same joint, so its signal is ambiguous.
    """
    counts: dict[str, list[int]] = {}
    for joints, group in publishers.items():
        size = sum(len(layout.rows) for layout in group)
        for joint in joints:
            counts.setdefault(joint, []).append(size)
        if joints:
            notes.append(f"{topic}: {size} messages of {', '.join(sorted(joints))} alone")
    for joint, sizes in sorted(counts.items()):
        if len(sizes) > 1:
            raise BagError(two_publishers(bag, topic, joint, sizes))


def two_publishers(bag: Bag, topic: str, joint: str, sizes: list[int]) -> str:
    """Error message for a joint that occurs in messages with different joint lists."""
    return (
        f"{bag.path.name}: {topic} tells of {joint} in messages with different joints "
        f"({' and '.join(map(str, sizes))} of them): two publishers, of which one may be a "
        "joint_state_publisher; record the topic of the drives alone"
    )


def _of_publisher(
    candidates: list[Layout], t: np.ndarray, topic: str, roles: dict[str, str]
) -> list[Track]:
    """Tracks of messages with the same joints; messages without a field add no samples of it."""
    result = []
    for name, role in roles.items():
        having = [layout for layout in candidates if layout.values and name in layout.values[0]]
        if not having:
            continue
        rows = np.concatenate([layout.rows for layout in having])
        order = np.argsort(rows)
        columns = {
            joint: np.concatenate(
                [np.array([v[name][layout.names.index(joint)] for v in layout.values])
                 for layout in having]
            )[order]
            for joint in having[0].names
        }  # fmt: skip
        if role not in ("q", "command_position") and not any(map(np.any, columns.values())):
            continue  # drivers fill unmeasured fields with zeros
        result += [Track(role, joint, t[rows[order]], x, topic) for joint, x in columns.items()]
    return result


def common_clock(times: Sequence[tuple[np.ndarray, np.ndarray]]) -> str:
    """Clock that topics have in common, one of `mapping.CLOCKS`; empty for their stamps.

    Topics that were recorded together may have stamps that are not: of a simulation and of the
    computer, or none beside others.

    Args:
        times: Stamps and log times of the messages of each topic [ns], all 0 without stamps.
    """
    both = [(stamps if np.any(stamps) else logged, logged) for stamps, logged in times]
    if not both or not all(len(logged) for _, logged in both):
        return ""
    last, first = (np.array([[f(x) for x in pair] for pair in both]) for f in (np.max, np.min))
    stamped, logged = first.max(axis=0) > last.min(axis=0)
    return "log" if stamped and not logged else ""


def clock(
    stamps: np.ndarray, logged: np.ndarray, topic: str, notes: list[str], which: str = ""
) -> np.ndarray:
    """Times of messages [s]: their stamps, or the log times if they have no stamps.

    Args:
        stamps: Stamps of the messages [ns]; all 0 if they have none.
        logged: Log times, at which the recorder received the messages [ns].
        topic: Name of the topic, for notes and error messages.
        notes: List to which a sentence on the difference of both clocks is appended.
        which: One of `mapping.CLOCKS`; empty for the stamps if there are any.

    Raises:
        ParameterError: Stamps are requested, but the messages have none.
    """
    if not np.any(stamps):
        if which == "stamp":
            raise ParameterError(f"{topic} has no stamps for clock: stamp; say clock: log")
        add_note(notes, Doubt(f"{topic} has no stamps: the times of logging were taken"))
        return logged / 1e9
    late = 1e-6 * np.median(logged - stamps)  # [ms]
    if which in ("log", "receive"):
        after = f"{late:.1f} ms" if abs(late) < 1e4 else f"{1e-3 * late:.6g} s"
        add_note(notes, Doubt(f"{topic} goes by the log's clock, {after} after its stamps"))
        return logged / 1e9
    if abs(late) > 1.0:
        add_note(notes, Doubt(f"{topic} was logged {late:.1f} ms after its stamps"))
    return stamps / 1e9
