# SPDX-License-Identifier: Apache-2.0
"""HyQ, bolted in the air: friction that is hidden in one of twelve joints is named there.

The measurements are the model's own in steps without length, with the noise of its sensors.
"""

import numpy as np
import pytest

from loco_learning.gap import workflow
from loco_learning.gap.fitting.params import GapParams
from loco_learning.gap.prediction.forward import Forward
from loco_learning.gap.recordings.record import Record
from loco_sim.plant.model import Model

HYQ = Model("hyq", {"fixed_base": True, "height": 1.0})
NOISE = {"q": 4e-5, "tau": 0.2}  # [rad], [N·m]
QUICK = GapParams(effects=("coulomb_friction", "viscous_friction"), most_terms=1)


def records(effects):
    """Two motions of all joints, the second to judge on."""
    robot, rng = HYQ.make_robot(), np.random.default_rng(1)
    t = np.arange(200) / 250.0
    ramp = np.clip(t / 0.2, 0.0, 1.0)[:, None]
    waves = [0.25 * np.sin(2 * np.pi * f * t)[:, None] * np.ones(12) for f in (0.8, 1.6)]
    empty = []
    for name, wave in zip(("fit", "judge"), waves, strict=True):
        q = robot.standing + ramp * wave
        wanted = {"position": q, "velocity": np.gradient(q, t, axis=0)}
        nothing = {signal: np.zeros_like(q) for signal in NOISE}
        empty.append(Record(name, t, wanted, robot.joints, nothing, robot.joints))
    model = Forward(HYQ, empty)
    coarse, fine = (model(effects, step=step) for step in (1 / 4, 1 / 8))
    made = []
    for r, c, f in zip(empty, coarse, fine, strict=True):
        said = 2.0 * f - c
        signals = {
            s: said[:, [i for i, k in enumerate(model.channels) if k.signal == s]]
            + noise * rng.standard_normal((len(t), 12))
            for s, noise in NOISE.items()
        }
        made.append(Record(r.name, t, r.command, r.driven, signals, r.joints))
    return made[:1], made[1:]


def test_friction_in_one_knee_is_named():
    gap = workflow.find(
        HYQ, *records([{"name": "coulomb_friction", "joint": "rf_kfe_joint", "torque": 5.0}]), QUICK
    )
    assert (gap["verdict"], gap["names"]) == ("named", ["coulomb_friction"])
    (term,) = gap["terms"]
    assert term["place"] == "rf_kfe_joint"
    assert term["parameters"]["torque"]["value"] == pytest.approx(5.0, rel=0.05)
