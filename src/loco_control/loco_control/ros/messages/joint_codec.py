# SPDX-License-Identifier: Apache-2.0
"""Conversion of JointState and Imu messages to arrays and back, for graphs of standard messages.

Messages in the layout of loco's own nodes are read directly from their bytes. Other messages
(another frame, another order of joints, no velocities) are decoded field by field and sorted
by joint name.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ...exceptions import NameUnknownError, ParameterError
from .codec import Codec
from .convert import block_view, stamp_views, write_stamp
from .plain import deserialize, message_class

JointState, Imu = message_class("sensor_msgs/msg/JointState"), message_class("sensor_msgs/msg/Imu")
FRAME = "base_link"
_STAMP = slice(4, 12)  # bytes of seconds and nanoseconds in every message with a header


class Joints(NamedTuple):
    """Contents of a JointState message, in the joint order of its codec."""

    time: int  # stamp [ns]
    q: np.ndarray  # [rad], (n,)
    dq: np.ndarray  # [rad/s], (n,)
    tau: np.ndarray  # [N·m], (n,)


class ImuSample(NamedTuple):
    """Contents of an Imu message."""

    time: int  # stamp [ns]
    orientation: np.ndarray  # quaternion x y z w, (4,)
    angular_velocity: np.ndarray  # [rad/s], (3,)
    linear_acceleration: np.ndarray  # [m/s²], (3,)


def stamp_ns(data: bytes) -> int:
    """Stamp of a serialised message that begins with a header [ns]."""
    seconds = int.from_bytes(data[_STAMP.start : _STAMP.start + 4], "little", signed=True)
    return seconds * 1_000_000_000 + int.from_bytes(data[_STAMP.start + 4 : _STAMP.stop], "little")


def tick_of(time_ns: int, rate: float) -> int:
    """Tick whose stamp is `time_ns` at a control rate [Hz]."""
    return round(time_ns * 1e-9 * rate)


class JointCodec:
    """Reader and writer of JointState messages of given joints.

    Args:
        names: Joint names, in the order of the arrays.
        what: Name of the messages in errors, e.g. their topic.
        fields: Names of the written fields, among position, velocity and effort.
        frame: Frame of the header.
    """

    def __init__(
        self,
        names: Sequence[str],
        what: str = "joint_states",
        fields: Sequence[str] = ("position", "velocity", "effort"),
        frame: str = "",
    ):
        self.names, self.what = tuple(names), what
        self._index = {name: i for i, name in enumerate(self.names)}
        n = len(self.names)
        template = JointState(name=list(self.names), **{f: [0.0] * n for f in fields})
        template.header.frame_id = frame
        self._codec = Codec(template)
        self._record = self._codec.record()
        self._stamp = stamp_views(self._record, "header.stamp")
        # The command of a robot without drives has no joints: its empty list has no field.
        self._views = [block_view(self._record, f, n) if n else np.zeros(0) for f in fields]
        self._layout = _Layout(self._codec, {f: n for f in fields})
        self._fields = ("position", "velocity", "effort")
        self._zeros = np.zeros(n)

    def pack(self, t: float, *values: np.ndarray) -> bytes:
        """Serialised message at time t [s], with an array (n,) for each field that is written."""
        write_stamp(self._stamp, t)
        for view, value in zip(self._views, values, strict=True):
            view[...] = value
        return self._record.tobytes()

    def read(self, data: bytes) -> Joints:
        """Arrays of a serialised message, in the joint order of the codec; absent fields are zeros.

        Raises:
            NameUnknownError: The message names a joint that is not in `names`.
            ParameterError: A joint is missing, or the lengths of the arrays differ.
        """
        values = self._layout.read(data)
        if values is None:
            return self._read_any(data)
        return Joints(stamp_ns(data), *(values.get(f, self._zeros) for f in self._fields))

    def read_layout(self, data: bytes) -> dict[str, np.ndarray] | None:
        """Arrays (n,) by field of a message in this codec's layout; None for another layout."""
        return self._layout.read(data)

    def finite(self, data: bytes, value: Joints) -> bool:
        """Whether positions and velocities are present and finite; drivers may omit the effort."""
        return bool(np.isfinite(value.q).all() and np.isfinite(value.dq).all())

    def _read_any(self, data: bytes) -> Joints:
        try:
            message = deserialize(data, JointState)
        except ParameterError as error:
            raise ParameterError(f"{self.what}: {error}") from None
        for name in message.name:
            if name not in self._index:
                raise NameUnknownError(f"joint in {self.what}", name, self.names)
        missing = [name for name in self.names if name not in message.name]
        if missing or len(message.name) != len(self.names):
            raise ParameterError(
                f"{self.what} must name each of {', '.join(self.names)} once; "
                f"got {', '.join(message.name) or 'none'}"
            )
        order = [self._index[name] for name in message.name]
        values = [self._ordered(getattr(message, f), f, order) for f in self._fields]
        return Joints(stamp_ns(data), *values)

    def _ordered(self, values: Sequence[float], field: str, order: list[int]) -> np.ndarray:
        out = np.zeros(len(self.names))
        if len(values) == 0 and field != "position":
            return out
        if len(values) != len(order):
            raise ParameterError(
                f"{self.what} must have {len(order)} values in {field}, got {len(values)}"
            )
        out[order] = values
        return out


class ImuReader:
    """Reader of Imu messages."""

    _LENGTHS = {"orientation.x": 4, "angular_velocity.x": 3, "linear_acceleration.x": 3}

    def __init__(self, frame: str = FRAME):
        template = Imu()
        template.header.frame_id = frame
        self._layout = _Layout(Codec(template), self._LENGTHS, "orientation.x")

    def read(self, data: bytes) -> ImuSample:
        """Arrays of a serialised message.

        Raises:
            ParameterError: The bytes are not an Imu message.
        """
        values = self._layout.read(data)
        if values is not None:
            return ImuSample(stamp_ns(data), *values.values())
        try:
            m = deserialize(data, Imu)
        except ParameterError as error:
            raise ParameterError(f"imu/data: {error}") from None
        q, w, a = m.orientation, m.angular_velocity, m.linear_acceleration
        return ImuSample(
            stamp_ns(data),
            np.array([q.x, q.y, q.z, q.w]),
            np.array([w.x, w.y, w.z]),
            np.array([a.x, a.y, a.z]),
        )

    def finite(self, data: bytes, value: ImuSample) -> bool:
        """Whether all numbers are finite."""
        return bool(np.isfinite(np.concatenate(value[1:])).all())


class _Layout:
    """Offsets of blocks of doubles in messages of one layout, and the bytes that identify it.

    Args:
        codec: Codec of a message that serves as template.
        lengths: Number of doubles of the block that begins at each field.
        first: First field after the texts; default the first field.
    """

    def __init__(self, codec: Codec, lengths: dict[str, int], first: str | None = None):
        self._size = codec.dtype.itemsize
        offsets = {name: codec.dtype.fields[name][1] for name in lengths if lengths[name]}
        self._offsets = [(name, at, lengths[name]) for name, at in offsets.items()]
        # Bytes between stamp, texts and arrays that must equal those of the template.
        block_ends = [_STAMP.stop, *(at + 8 * n for _, at, n in self._offsets)]
        starts = [at for _, at, _ in self._offsets]
        gaps = zip(block_ends, [*starts, self._size], strict=True)
        if first is not None:  # other numbers, e.g. covariances, lie between the blocks
            gaps = [(_STAMP.stop, offsets[first])]
        self._gaps = [(a, b, codec.template[a:b]) for a, b in gaps if b > a]

    def read(self, data: bytes) -> dict[str, np.ndarray] | None:
        """Copies of the blocks by field, or None if the message has another layout.

        Unused bytes at the end, which some writers leave, are ignored.
        """
        if len(data) < self._size or any(data[a:b] != text for a, b, text in self._gaps):
            return None
        return {
            name: np.frombuffer(data, np.float64, n, at).copy() for name, at, n in self._offsets
        }
