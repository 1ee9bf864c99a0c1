# SPDX-License-Identifier: Apache-2.0
"""What is known up to the scale of the drives' torque, and that it is said."""

import pytest

from loco_bringup.gap.importing import load
from loco_learning.gap.fitting.fit import weigh
from loco_learning.gap.hypotheses.hypotheses import Hypothesis
from loco_learning.gap.prediction import case as cases
from loco_learning.gap.prediction.forward import Forward, ForwardParams
from loco_learning.gap.verdict import scale
from loco_sim.effects.coordinates import Coordinate
from loco_sim.plant.model import Model

KG = Coordinate("mass", 0.5, (1.0,), 0.0, 5.0, "kg", strength=True)
SHARE = Coordinate("share", 0.1, (1.0,), 0.0, 0.9, "-", strength=True)
PAYLOAD = Hypothesis(
    "payload", "pendulum", (("link", "pendulum"), ("position", (0.0, 0.0, -0.5))), (KG,)
)
LOAD = Hypothesis("load_friction", "motor_joint", (("joint", "motor_joint"),), (SHARE,))
DRIVE = {"drives.motor_joint.gain": 0.7}


@pytest.fixture(scope="module")
def heavier(repository):
    """The pendulum that carries 1 kg, in pieces of half a second."""
    model = Model(str(repository / "bags/measured/dfki_pendulum"), DRIVE)
    told = [r for r in load(model.robot, model.make_robot()) if r.name == "1 kg"]
    return cases.prepare(Forward(model, told, ForwardParams(window=0.5)), told, [])


def test_scales_reach_every_drive_and_link(heavier):
    robot = heavier.forward.robot()
    assert scale.torques(robot, 2.0) == {"drives.motor_joint.gain": 1.4}
    twice = Model(heavier.forward.model.robot, scale.masses(robot, 2.0)).make_robot()
    assert scale.masses(twice, 1.0) == pytest.approx(scale.masses(robot, 2.0))


def test_a_payload_and_the_torque_show_as_a_ratio_only(heavier):
    model = weigh(heavier, [(PAYLOAD, (1.0,)), (LOAD, (0.1,))], {})
    (row,) = scale.ambiguous(heavier, model)  # a share of the torque has no unit of force
    assert 0.95 < row["torque"] <= row["torque_and_masses"] + 1e-9
    (text,) = scale.words(heavier, model)
    assert "payload mass pendulum" in text and "only their ratio shows" in text


def test_gains_of_stance_and_swing_scale_together():
    hyq = Model("hyq").make_robot()
    for factor in (0.5, 2.0):
        scaled = Model("hyq", scale.torques(hyq, factor)).make_robot()
        for joint, drive in hyq.drives.items():
            assert (scaled.drives[joint].kp, scaled.drives[joint].kd) == (
                factor * drive.kp,
                factor * drive.kd,
            )
            assert scaled.drives[joint].swing == tuple(factor * gain for gain in drive.swing)
