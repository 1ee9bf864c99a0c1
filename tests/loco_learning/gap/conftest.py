# SPDX-License-Identifier: Apache-2.0
"""A hinge that follows its command, as robots, files and signals."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from loco_learning.gap.tracks import Track
from loco_sim.robot import Robot
from loco_sim.servo import ServoParams, TorqueDrive

URDF = """<robot name="one"><link name="base"/><link name="arm"/>
<joint name="{joint}" type="{kind}"><parent link="base"/><child link="arm"/>
<limit lower="-1.6" upper="1.6" effort="3.0" velocity="20"/></joint></robot>"""


@pytest.fixture(scope="session")
def one_joint():
    """Function that makes a robot of one driven joint."""

    def make(joint="hinge", kind="revolute", drive=None) -> Robot:
        return Robot(
            name="one",
            urdf=URDF.format(joint=joint, kind=kind),
            folder=Path(),
            joints=(joint,),
            feet=(),
            standing=np.zeros(1),
            effort=np.array([3.0]),
            driven=np.array([0]),
            drives={joint: drive or ServoParams()},
        )

    return make


@pytest.fixture(scope="session")
def torque_drive():
    return TorqueDrive()


@pytest.fixture
def hinge(one_joint):
    return one_joint()


@pytest.fixture
def signals():
    """Function that makes tracks of 4 s at 100 Hz: the hinge is 30 ms behind its command.

    Arguments are factors by role, or functions of the tracks of a role.
    """

    def make(start=0.0, rate=100.0, seconds=4.0, **changes) -> list[Track]:
        t = start + np.arange(round(seconds * rate)) / rate
        late = t - 0.03
        angle = {
            "command_position": 0.9 * np.sin(4.0 * t) + 0.4 * np.sin(11.0 * t),
            "q": 0.9 * np.sin(4.0 * late) + 0.4 * np.sin(11.0 * late),
            "dq": 3.6 * np.cos(4.0 * late) + 4.4 * np.cos(11.0 * late),
        }
        made = []
        for role, x in angle.items():
            track = Track(role, "hinge", t, x, f"column {role!r}")
            change = changes.get(role, 1.0)
            track = change(track) if callable(change) else replace(track, x=change * x)
            made += [] if track is None else [track]
        return made

    return make


@pytest.fixture(scope="session")
def change():
    """Function that makes a track with other times or values of one."""
    return replace
