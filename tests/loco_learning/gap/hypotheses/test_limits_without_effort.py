# SPDX-License-Identifier: Apache-2.0
"""A motor that saturates, in a robot whose description has no limits of its drives."""

from dataclasses import replace

import numpy as np
import pytest
import yaml

from loco_control.exceptions import ParameterError
from loco_learning.gap.fitting.screen import screen
from loco_learning.gap.hypotheses import hints
from loco_learning.gap.hypotheses.bundles import Batch
from loco_learning.gap.hypotheses.hypotheses import offer
from loco_learning.gap.prediction import case as cases
from loco_learning.gap.prediction.forward import Forward
from loco_learning.gap.recordings.record import Record
from loco_learning.gap.setup.family import find_mistakes
from loco_sim.effects.base import make
from loco_sim.plant.model import Model
from loco_sim.robot import robot

LIMITED = {
    "torque_limit": {"rated": 10.0, "reduction": 0.65},
    "torque_speed_line": {"rated": 6.0, "slope": 0.06},
}


@pytest.fixture
def model(tmp_path):
    """A rod that a drive without limit lifts."""
    urdf = (robot.load("servo_pendulum").folder / "servo_pendulum.urdf").read_text()
    (tmp_path / "rod.urdf").write_text(urdf.replace(' effort="2.6"', ""))
    drive = {"kind": "impedance", "kp": 20.0, "kd": 0.8}
    about = {"urdf": "rod.urdf", "joints": ["pivot"], "fixed_base": True, "standing": [0.0],
             "control_rate": 200, "drives": {"pivot": drive}}  # fmt: skip
    (tmp_path / "robot.yaml").write_text(yaml.safe_dump(about))
    return Model(str(tmp_path))


def recorded(model, effects, seed=1):
    rng, t = np.random.default_rng(seed), np.arange(1200) / 200.0
    command = {"position": np.repeat(rng.uniform(-1.2, 1.2, 6), 200)[:, None]}
    zeros = np.zeros((len(t), 1))
    empty = Record("r", t, command, ("pivot",), {"q": zeros, "dq": zeros}, ("pivot",))
    (made,) = Forward(model, [empty])(effects, step=1 / 8)
    q, dq = np.split(made + rng.normal(size=made.shape) * [2e-4, 5e-3], 2, axis=1)
    return replace(empty, signals={"q": q, "dq": dq})


@pytest.mark.parametrize("name", LIMITED)
def test_a_limit_that_no_description_has_is_found(model, name):
    """Steps ask for twenty times the torque that there is."""
    records = [recorded(model, [{"name": name, **LIMITED[name]}], seed) for seed in (1, 2)]
    case = cases.prepare(Forward(model, records), records[:1], records[1:])
    plant, forward = case.forward.robot(), case.forward
    offered = offer(plant, case.signals, hints.find(case, plant))
    (limit,) = [h for h in hints.sized(offered, forward) if h.effect == name]
    residual = case.vector([], {}, case.fitted, coarse=True)
    (trial,) = screen(case, Batch((limit,), (None,)), [], {}, case.fitted, residual)
    assert trial.share > 0.9
    assert make(name, **limit.term(trial.x).params).rated > 0.0


def test_a_drive_gives_what_the_motion_needs_whatever_its_controller_asks_for(model):
    limited = [{"name": "torque_limit", **LIMITED["torque_limit"]}]
    forward = Forward(model, [recorded(model, limited)])
    assert hints.acting(forward)[0] == pytest.approx(3.5, rel=0.2)
    assert np.nanmax(np.abs(forward.drives()[0])) > 30.0


def test_a_limit_is_told_as_a_torque():
    pendulum = robot.load("pendulum")  # with an effort of 2 N·m
    told = make("torque_limit", joint="pivot", reduction=0.3).amount(pendulum)
    assert told == "the limit is 1.4 N·m"
    assert make("torque_limit", joint="a", **LIMITED["torque_limit"]).amount(None) == (
        "the limit is 3.5 N·m"
    )
    assert make("torque_limit", reduction=0.3).amount(None) == ""


def test_a_share_of_no_limit_is_refused(model):
    record = recorded(model, [])
    with pytest.raises(ParameterError, match="torque limit"):
        Forward(model, [record])([{"name": "torque_limit", "reduction": 0.3}])


@pytest.mark.parametrize("reduction", [0.65, 0.8])
def test_a_motor_that_saturates_is_no_wrong_scale(model, reduction):
    limited = [{"name": "torque_limit", "rated": 10.0, "reduction": reduction}]
    assert find_mistakes(model, [recorded(model, limited)]) == []
