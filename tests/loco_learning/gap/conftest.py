# SPDX-License-Identifier: Apache-2.0
"""A hinge that follows its command, as robots, files and signals; a slide that was recorded."""

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from loco_learning.gap.hypotheses import hints
from loco_learning.gap.hypotheses.bundles import Batch
from loco_learning.gap.hypotheses.hypotheses import offer
from loco_learning.gap.prediction import case as cases
from loco_learning.gap.prediction.forward import Forward
from loco_learning.gap.recordings.record import Record
from loco_learning.gap.recordings.tracks import Track
from loco_sim.plant.model import Model
from loco_sim.robot.robot import Robot
from loco_sim.robot.servo import ServoParams, TorqueDrive

SLIDE = Model("linear_axis")
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


def records(effects=(), noise=5e-5, seed=0, judged=1.0, overrides=None):
    """Three short motions of the bench, the last, as large as wanted, to judge on."""
    rng = np.random.default_rng(seed)
    t = np.arange(500) / 250.0
    ramp = np.clip(t / 0.2, 0.0, 1.0)
    motions = {
        "chirp": 0.1 * ramp * np.sin(2 * np.pi * (0.5 + t) * t),
        "slow": 0.08 * ramp * np.sin(2 * np.pi * 0.6 * t),
        "judge": judged * ramp * (0.12 * np.sin(1.8 * np.pi * t) + 0.03 * np.sin(20.0 * t)),
    }
    empty = []
    for name, command in motions.items():
        wanted = {"position": command[:, None], "velocity": np.gradient(command, t)[:, None]}
        empty.append(Record(name, t, wanted, ("slide",), {"q": wanted["position"]}, ("slide",)))
    model = Forward(SLIDE, empty)
    coarse, fine = (model(effects, overrides, step=step) for step in (1 / 8, 1 / 16))
    said = [2.0 * f - c for f, c in zip(fine, coarse, strict=True)]  # no step at all
    made = [
        Record(r.name, r.t, r.command, r.driven,
               {"q": q + noise * rng.standard_normal(q.shape)}, r.joints)
        for r, q in zip(empty, said, strict=True)
    ]  # fmt: skip
    return made[:2], made[2:]


@pytest.fixture(scope="session")
def slide():
    """The model of a bench, and the function that makes its records."""
    return SimpleNamespace(model=SLIDE, records=records)


@pytest.fixture(scope="session")
def bench():
    """Function that makes a case, and what may be tried on it, by effect."""

    def make(effects):
        fit, judge = records(effects)
        forward = Forward(SLIDE, [*fit, *judge])
        case, robot = cases.prepare(forward, fit, judge), forward.robot(0)
        offered = offer(robot, case.signals, hints.find(case, robot))
        return case, {h.effect: Batch((h,), (None,)) for h in offered}

    return make


SERVO = {"drives.pivot.stall_torque": 2.6 * 0.981, "drives.pivot.no_load_speed": 13.2 / 0.981}


@pytest.fixture(scope="session")
def servo():
    """Function that makes a case by effects: a drive that rounds its encoder, a little weak.

    What the drive really is stands in its attribute `truth`.
    """

    def make(effects=()):
        t, step = np.arange(400) / 100.0, 0.00506
        motions = {
            "steps": 0.9 * np.sign(np.sin(4.0 * t)) * (t > 0.2),
            "chirp": 0.6 * np.sin(2.0 * np.pi * (0.2 + 0.35 * t) * t),
        }
        made = []
        for name, q in motions.items():
            told = {"position": q[:, None]}, ("pivot",), {"q": q[:, None]}, ("pivot",)
            empty = Record(name, t, *told)
            (seen,) = Forward(Model("servo_pendulum"), [empty])(effects, SERVO, step=1 / 8)
            made.append(replace(empty, signals={"q": step * np.round(seen / step)}))
        return cases.prepare(Forward(Model("servo_pendulum"), made), made, [])

    make.truth = SERVO
    return make
