# SPDX-License-Identifier: Apache-2.0
"""Packing and unpacking a dataclass is the identity."""

import dataclasses

import numpy as np
import pytest

from loco_control import types
from loco_control.ros.messages.convert import Converter

SHAPES = {
    "grf": (4, 3),
    "foot_position": (4, 3),
    "foot_velocity": (4, 3),
    "orientation": (4,),
    "angular_velocity": (3,),
    "linear_acceleration": (3,),
    "phase": (4,),
    "foot_height": (4,),
    "wrench": (6,),
    "prediction": (16,),
}
CLASSES = [
    types.RobotState,
    types.GaitTarget,
    types.MotionCommand,
    types.Stance,
    types.TrunkTorque,
    types.LearningState,
]


def example(cls, rng):
    values = {"tick": 41, "t": 0.164}
    for f in dataclasses.fields(cls):
        if f.name in values:
            continue
        if f.type in ("float", float):
            values[f.name] = rng.normal()
        elif f.type in ("bool", bool):
            values[f.name] = True
        elif f.type in ("int", int):
            values[f.name] = 1
        elif f.name in ("stance", "contact"):
            values[f.name] = rng.integers(0, 2, 4).astype(bool)
        else:
            values[f.name] = rng.normal(size=SHAPES.get(f.name, (12,)))
    return cls(**values)


@pytest.mark.parametrize("cls", CLASSES, ids=lambda c: c.__name__)
def test_unpack_after_pack_is_identity(cls):
    converter = Converter(cls)
    value = example(cls, np.random.default_rng(2))
    again = converter.unpack(converter.codec.decode(converter.pack(value)))
    for f in dataclasses.fields(cls):
        np.testing.assert_array_equal(getattr(again, f.name), getattr(value, f.name), f.name)


@pytest.mark.parametrize("tick", [0, 1, 249, 250, 12_345, 10_000_000])
def test_time_survives_the_stamp(tick):
    converter = Converter(types.MotionCommand)
    t = tick * 0.004
    value = types.MotionCommand(tick, t, np.zeros(12), np.zeros(12))
    again = converter.unpack(converter.codec.decode(converter.pack(value)))
    assert again.t == pytest.approx(t, rel=1e-15)
    assert converter.pack(again) == converter.pack(value)


def test_read_shares_equal_bytes_and_nothing_else():
    converter, other = Converter(types.MotionCommand), Converter(types.MotionCommand)
    rng = np.random.default_rng(3)
    first, second = (converter.pack(example(types.MotionCommand, rng)) for _ in range(2))
    one = converter.read(first)
    assert other.read(bytes(bytearray(first))) is one
    two = other.read(second)
    assert two is not one
    np.testing.assert_array_equal(two.q, other.unpack(other.codec.decode(second)).q)
    np.testing.assert_array_equal(converter.read(first).q, one.q)
