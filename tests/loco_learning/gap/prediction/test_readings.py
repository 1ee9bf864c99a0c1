# SPDX-License-Identifier: Apache-2.0
"""When a reading was taken is no gap: clocks of drives, torques of an instant, thinned commands."""

import math

import numpy as np
import pytest
import yaml
from scipy.interpolate import CubicSpline

from loco_learning.gap.importing import importing
from loco_learning.gap.prediction import case as cases
from loco_learning.gap.prediction import nominal
from loco_learning.gap.prediction.forward import Forward
from loco_learning.gap.recordings import mapping
from loco_learning.gap.statistics import evidence
from loco_learning.gap.statistics.leftover import has_gap
from loco_learning.gap.verdict import scale
from loco_sim.plant.model import Model

MASS, CENTRE, INERTIA, KP, KD, GRAVITY = 0.8, 0.2, 0.008, 12.0, 0.4, 9.81
RATE, SECONDS = 250, 4.0
URDF = f"""<robot name="rod"><link name="base"/><link name="rod"><inertial>
<origin xyz="0 0 {-CENTRE}"/><mass value="{MASS}"/>
<inertia ixx="{INERTIA}" iyy="{INERTIA}" izz="1e-4" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="hinge" type="revolute"><parent link="base"/><child link="rod"/><axis xyz="0 -1 0"/>
<limit lower="-2.5" upper="2.5" effort="30" velocity="20"/></joint></robot>"""


def swing(seed, read="mean", period=1e-4, friction=0.0, late=0.0, kd=KD):
    """Rows of t, q, tau, cmd of a rod whose drive finds its torque anew in every period [s]."""
    rng = np.random.default_rng(seed)
    f, p = rng.uniform(0.2, 2.5, 6), rng.uniform(0.0, 6.0, 6)
    t = np.arange(round(SECONDS * RATE)) / RATE
    ramp = np.minimum(1.0, t / 0.5)
    wave = np.sin(2.0 * np.pi * f * t[:, None] + p) - np.sin(p)
    told = 0.35 * ramp * np.sum(wave, axis=1) / math.sqrt(6.0)
    inertia, weight = INERTIA + MASS * CENTRE**2, MASS * GRAVITY * CENTRE
    per = round(1.0 / RATE / period)
    wait = round(late / period)
    queue, rows, q, v, mean, before = [0.0] * wait, [], 0.0, 0.0, 0.0, 0.0

    def pull(q, v, tau):
        return (tau - weight * math.sin(q) - friction * math.tanh(v / 5e-3)) / inertia

    for goal in told:
        for k in range(per):
            queue.append(KP * (goal - q) - kd * v)
            tau = queue.pop(0)
            if k == 0:
                rows.append((q, {"mean": mean / per, "before": before, "after": tau}[read]))
                mean = 0.0
            mean, a = mean + tau, pull(q, v, tau)
            middle = v + 0.5 * period * a
            q, v = q + period * middle, v + period * pull(q + 0.5 * period * v, middle, tau)
            before = tau
    seen = np.array(rows) + rng.normal(size=(len(t), 2)) * (1e-4, 0.01)
    return np.column_stack([t, seen, told])


@pytest.fixture
def rod(tmp_path):
    """Function that makes a case of three records, every so many rows of each, as files."""

    def make(every=1, roles=("q", "tau"), jitter=0.0, constant=0.0, **about):
        drive = {"hinge": {"kind": "impedance", "kp": KP, "kd": about.get("kd", KD)}}
        robot = {"urdf": "rod.urdf", "fixed_base": True, "height": 1.0, "joints": ["hinge"],
                 "control_rate": RATE, "drives": drive}  # fmt: skip
        clock = {"time": "read"} if jitter else {}
        columns = [{"column": r, "role": r, "joint": "hinge", **clock} for r in roles]
        if constant:
            columns[1] |= {"unit": "A", "scale": 1.0}
        columns.append({"column": "cmd", "role": "command_position", "joint": "hinge"})
        rules = {"files": "*.csv", "time": {"column": "t"}, "columns": columns}
        (tmp_path / "rod.urdf").write_text(URDF)
        (tmp_path / "robot.yaml").write_text(yaml.safe_dump(robot))
        (tmp_path / "mapping.yaml").write_text(yaml.safe_dump(rules))
        for seed in (1, 2, 3):
            rows = swing(seed, **about)[::every]
            rows[:, 2] /= constant or 1.0
            path, rng = tmp_path / f"run{seed}.csv", np.random.default_rng(seed)
            t, when = rows[:, 0], rows[:, 0] + jitter / RATE * rng.normal(size=len(rows))
            if jitter:  # read at uneven times, and stamped when it arrives
                rows[:, 1] = CubicSpline(t, rows[:, 1])(when)
            stamps = np.maximum.accumulate(when + rng.uniform(0.0, 1.2 / RATE, len(t)))
            rows = np.column_stack([rows, stamps])
            np.savetxt(path, rows, "%.7g", ",", header="t,q,tau,cmd,read", comments="")
        model = Model(str(tmp_path))
        known = mapping.load(tmp_path / "mapping.yaml")
        records = importing.load(tmp_path, model.make_robot(), known)
        return cases.prepare(Forward(model, records), records[:2], records[2:])

    return make


@pytest.mark.parametrize(
    ("read", "period"),
    [("mean", 1e-4), ("before", 2e-5), ("before", 1e-4), ("after", 2e-5), ("after", 1e-4)],
)
def test_a_right_model_leaves_noise_whenever_its_readings_were_taken(rod, read, period):
    case = rod(read=read, period=period)
    assert not has_gap(case.suited([], {})[0])
    assert has_gap(case.bare([]))


def test_torques_of_an_instant_are_told_where_the_model_makes_one_step_a_row(rod):
    forward = rod(read="after").forward
    once = Forward(Model(forward.model.robot, {"sim.physics_rate": RATE}), forward.records)
    fine, coarse = (f.reading_times([], {}, 1e-3)[0][:, 1, 2:] for f in (forward, once))
    assert np.abs(fine).max() > 0.05
    np.testing.assert_allclose(coarse, fine, atol=0.2 * np.abs(fine).max())


def test_readings_at_uneven_times_that_are_stamped_late_are_no_gap(rod):
    """No clock is in such stamps: the even one below them is early, and each reading is beside it.

    The right model left five noise floors, and its delay of a millisecond was named.
    """
    case = rod(roles=("q",), jitter=0.1)
    assert case.times == pytest.approx([0.1 / RATE] * 3, rel=0.2)
    assert not has_gap(case.whitened([]))
    assert has_gap(case.whitened([{"name": "armature", "inertia": 0.005}]))


@pytest.mark.parametrize("constant", [0.6, 1.0, 1.5])
def test_a_current_without_its_torque_constant_is_as_good_as_its_curve(rod, constant):
    case = rod(constant=constant)
    left, values, *_ = case.suited([], {})
    assert not has_gap(left)
    assert 1.0 + values["torque_reading.hinge"] == pytest.approx(constant, rel=0.03)
    load = [{"name": "payload", "link": "rod", "mass": 0.2, "position": [0.0, 0.0, -0.3]}]
    assert has_gap(case.suited(load, {})[0]), "the constant hides a mass"
    assert "torque_reading.hinge" not in nominal.written(case.forward.given(), values)
    assert scale.currents(values) and not scale.currents({})


def test_a_drive_that_samples_takes_damping_away_and_that_is_no_gap(rod):
    """Half a period of 0.1 ms takes 1.5 % of a small damping; the commands are not late."""
    case = rod(roles=("q",), kd=0.04)
    assert not has_gap(case.suited([], {})[0])
    (left,) = case.bare([])[-1:]
    assert evidence.rms([left]) > 2.0


@pytest.mark.parametrize("every", [2, 5, 10])
def test_a_right_model_leaves_noise_in_a_slow_log(rod, every):
    case = rod(every, roles=("q",))
    assert not has_gap(case.suited([], {})[0])
    assert case.records[0].unsure


@pytest.mark.parametrize("about", [{"friction": 0.02}, {"late": 2e-3}], ids=["friction", "delay"])
@pytest.mark.parametrize("every", [1, 5])
@pytest.mark.parametrize("read", ["mean", "after"])
def test_what_is_hidden_is_a_gap_all_the_same(rod, about, every, read):
    left, *_ = rod(every, read=read, **about).suited([], {})
    assert has_gap(left) and evidence.rms(left) > 3.0


def test_friction_explains_a_slow_log_from_any_size_nearby(rod):
    """Straight lines about a model without friction lead away from the right one."""
    case = rod(5, roles=("q",), friction=0.3)
    for torque in (0.295, 0.3, 0.305):
        left, *_ = case.suited([{"name": "coulomb_friction", "torque": torque}], {})
        assert evidence.rms(left) < 1.3, torque
