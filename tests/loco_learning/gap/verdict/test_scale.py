# SPDX-License-Identifier: Apache-2.0
"""What is known up to the scale of the drives' torque, and that it is said."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from loco_bringup.gap.importing import load
from loco_learning.gap.fitting.fit import weigh
from loco_learning.gap.hypotheses.hypotheses import Hypothesis
from loco_learning.gap.prediction import case as cases
from loco_learning.gap.prediction.forward import Forward, ForwardParams
from loco_learning.gap.prediction.nominal import nominal_value
from loco_learning.gap.verdict import scale
from loco_sim.effects.coordinates import Coordinate
from loco_sim.plant.model import Model

from .. import laws

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
    (text,) = scale.scale_messages(heavier, model)
    assert "payload mass pendulum" in text and "only their ratio shows" in text


def test_each_strength_is_compared_by_itself():
    """A payload as a weaker drive looks, and a friction that looks like nothing else."""
    t = np.linspace(0.0, 20.0, 500)
    rubs = Coordinate("torque", 0.05, (1.0,), 0.0, 10.0, "N·m", strength=True)
    robot = Model("pendulum").make_robot()

    def whitened(specs, overrides):
        values = {f"{s['name']}.{k}": v for s in specs for k, v in s.items() if k != "name"}
        gains = [
            v / nominal_value(robot, n) for n, v in overrides.items() if n.startswith("drives")
        ]
        row = (values["payload.mass"] - 9.0 * (np.mean(gains or [1.0]) - 1.0)) * np.sin(t)
        row = row + 3.0 * values["coulomb_friction.torque"] * np.sign(np.cos(3.0 * t))
        return [np.stack([row, 0.0 * t], axis=1)]

    given = SimpleNamespace(given=lambda overrides=None: robot)
    case = SimpleNamespace(cap=1e6, forward=given, whitened=whitened, signals=("q",))
    case.kept = lambda: case
    law = Hypothesis("coulomb_friction", "motor_joint", (), (rubs,))
    parts = (replace(PAYLOAD, fixed=()), (1.0,)), (law, (1.0,))
    rows = scale.ambiguous(case, replace(laws.fitted(laws.COULOMB), parts=parts))
    assert [row["torque"] for row in rows] == pytest.approx([1.0, 0.0], abs=0.05)


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
