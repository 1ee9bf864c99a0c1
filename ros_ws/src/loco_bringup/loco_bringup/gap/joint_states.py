# SPDX-License-Identifier: Apache-2.0
"""Topics of JointState as tracks: the readings that there are, each on its own stamp."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from loco_control.exceptions import BagError, LocoError, ParameterError
from loco_control.ros.messages.joint_codec import JointCodec, stamp_ns
from loco_learning.gap.recordings.record import Doubt
from loco_learning.gap.recordings.tracks import Track

from ..bag.reader import Bag

FIELDS = ("position", "velocity", "effort")


@dataclass
class Layout:
    """Messages that have the same joints in one order and the same fields.

    Attributes:
        names: Joints in the order of the arrays.
        codec: Reader of the messages.
        rows: Numbers of the messages on their topic.
        values: Arrays (n,) by field, of each message.
    """

    names: tuple[str, ...]
    codec: JointCodec
    rows: list[int] = field(default_factory=list)
    values: list[dict[str, np.ndarray]] = field(default_factory=list)


def tracks(bag: Bag, topic: str, roles: dict[str, str], notes: list[str]) -> list[Track]:
    """Signals of a topic, of the fields that its messages have.

    Several publishers may each tell of joints of their own, or of other fields.

    Args:
        bag: The recording.
        topic: Topic of JointState.
        roles: Roles of the signals by field.
        notes: Takes sentences on clocks and publishers.

    Raises:
        BagError: Messages are damaged, or two of different joints name the same one.
    """
    logged, data = bag.raw(topic)
    publishers: dict[frozenset[str], list[Layout]] = {}
    try:
        for layout in layouts(bag, topic, data):
            publishers.setdefault(frozenset(layout.names), []).append(layout)
        if len(publishers) > 1:
            _apart(bag, topic, publishers, notes)
        stamps = np.array([stamp_ns(message) for message in data], dtype=np.int64)
        found = []
        for some in publishers.values():
            rows = np.sort(np.concatenate([layout.rows for layout in some]))
            t = np.full(len(data), np.nan)
            t[rows] = clock(stamps[rows], logged[rows], topic, notes)
            found += _of_publisher(some, t, topic, roles)
    except LocoError as error:
        text = str(error)
        raise BagError(text if bag.path.name in text else f"{bag.path.name}: {text}") from None
    return found


def layouts(bag: Bag, topic: str, data: list[bytes]) -> list[Layout]:
    """Messages of a topic by their layout, in the order of the first of each.

    Raises:
        LocoError: The bytes are no JointState, or a field has not a value for each joint.
    """
    known: dict[tuple, Layout] = {}
    last: Layout | None = None
    for row, message in enumerate(data):
        values = last.codec.own(message) if last else None
        if values is None:
            last = _layout(bag, topic, message, known)
            values = last.codec.own(message)
        if values is None:  # bytes in another order, which the codec does not write
            decoded = bag.message(topic, message)
            arrays = {f: np.array(getattr(decoded, f), float) for f in FIELDS}
            values = {name: array for name, array in arrays.items() if len(array)}
        last.rows.append(row)
        last.values.append(values)
    return list(known.values())


def _layout(bag: Bag, topic: str, message: bytes, known: dict[tuple, Layout]) -> Layout:
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
    if key not in known:
        known[key] = Layout(names, JointCodec(names, topic, fields, decoded.header.frame_id))
    return known[key]


def _apart(
    bag: Bag, topic: str, publishers: dict[frozenset[str], list[Layout]], notes: list[str]
) -> None:
    """A note for each publisher, none of which tells of a joint of another.

    Raises:
        BagError: Two do: which of two series is the joint's is not for us to choose.
    """
    counts: dict[str, list[int]] = {}
    for joints, some in publishers.items():
        size = sum(len(layout.rows) for layout in some)
        for joint in joints:
            counts.setdefault(joint, []).append(size)
        if joints:
            notes.append(f"{topic}: {size} messages of {', '.join(sorted(joints))} alone")
    for joint, sizes in sorted(counts.items()):
        if len(sizes) > 1:
            raise BagError(two_publishers(bag, topic, joint, sizes))


def two_publishers(bag: Bag, topic: str, joint: str, sizes: list[int]) -> str:
    """Why a joint in messages with different joints is not read."""
    return (
        f"{bag.path.name}: {topic} tells of {joint} in messages with different joints "
        f"({' and '.join(map(str, sizes))} of them): two publishers, of which one may be a "
        "joint_state_publisher; record the topic of the drives alone"
    )


def _of_publisher(
    some: list[Layout], t: np.ndarray, topic: str, roles: dict[str, str]
) -> list[Track]:
    """Tracks of messages of the same joints; who leaves a field out has no readings of it."""
    found = []
    for name, role in roles.items():
        having = [layout for layout in some if layout.values and name in layout.values[0]]
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
            continue  # drivers fill what they do not measure with zeros
        found += [Track(role, joint, t[rows[order]], x, topic) for joint, x in columns.items()]
    return found


def clock(
    stamps: np.ndarray, logged: np.ndarray, topic: str, notes: list[str], which: str = ""
) -> np.ndarray:
    """Times of messages [s]: their stamps, or times of logging where they have none.

    Args:
        stamps: Stamps of the messages [ns]; 0 throughout where they have none.
        logged: Times of logging, at which the recorder received them [ns].
        topic: Their topic, for messages.
        notes: Takes a sentence on how both differ.
        which: One of `mapping.CLOCKS`; empty takes the stamps if there are some.

    Raises:
        ParameterError: Stamps are asked for and there are none.
    """
    if not np.any(stamps):
        if which == "stamp":
            raise ParameterError(f"{topic} has no stamps for clock: stamp; say clock: log")
        _note(notes, Doubt(f"{topic} has no stamps: the times of logging were taken"))
        return logged / 1e9
    late = 1e-6 * np.median(logged - stamps)  # [ms]
    if which in ("log", "receive"):
        _note(notes, Doubt(f"{topic} goes by the log's clock, {late:.1f} ms after its stamps"))
        return logged / 1e9
    if abs(late) > 1.0:
        _note(notes, Doubt(f"{topic} was logged {late:.1f} ms after its stamps"))
    return stamps / 1e9


def _note(notes: list[str], text: str) -> None:
    if text not in notes:
        notes.append(text)
