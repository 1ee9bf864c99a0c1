# SPDX-License-Identifier: Apache-2.0
"""What nobody knows exactly is no effect: a few percent of masses and drives, and the start."""

from __future__ import annotations

from collections import OrderedDict
from copy import copy
from dataclasses import replace

import numpy as np
import pytest
import yaml

from loco_learning.gap.fitting.fit import weigh
from loco_learning.gap.prediction import case as cases
from loco_learning.gap.prediction import loose
from loco_learning.gap.prediction.forward import Forward, ForwardParams
from loco_learning.gap.prediction.running import Start
from loco_learning.gap.recordings.record import Record
from loco_learning.gap.statistics import evidence
from loco_sim.plant.model import Model
from loco_sim.robot import robot

FRICTION = {"name": "coulomb_friction", "torque": 3.0}
OFF = {"bodies.carriage.mass": 1.02, "drives.slide.kp": 1970.0, "drives.slide.kd": 59.1}


def of(slide, effects):
    fit, judge = slide.records(effects, overrides=OFF, noise=1e-3)
    return cases.prepare(Forward(slide.model, [*fit, *judge]), fit, judge)


def test_a_model_that_is_a_little_off_explains_what_it_made(slide):
    case = of(slide, [])
    left, values, price, *_ = case.suited([], {})
    assert evidence.rms(case.bare([])) > 3.0
    assert evidence.rms(left) < 1.1
    assert values["torque_constant_error.slide"] == pytest.approx(-0.015, abs=0.01)
    assert 0.3 < price < 3.0


def test_an_effect_is_not_taken_for_a_model_that_is_off(slide):
    case = of(slide, [FRICTION])
    assert evidence.rms(case.suited([], {})[0]) > 3.0
    assert evidence.rms(case.suited([FRICTION], {})[0]) < 1.1
    given = weigh(case, (), {}, initial=True)
    assert given.loose == {} and given.pull < 3 * 0.5 * loose.RANGE**2  # of three clocks alone


def test_where_a_record_begins_is_no_gap():
    """A pendulum that swings when the log begins, elsewhere than its readings say."""
    t = np.arange(300) / 100.0
    push = 0.4 * np.sin(4.0 * t)[:, None]
    seen = 0.4 * np.sin(4.0 * t - 0.5)[:, None]
    empty = Record("r", t, {"position": push}, ("pivot",), {"q": seen}, ("pivot",))
    forward = Forward(Model("servo_pendulum", {"drives.pivot.resolution": 0.0}), [empty])
    (q,) = forward.begun_at([np.array([0.004, 0.4])])(step=1 / 8)
    noise = 0.004 * np.random.default_rng(2).standard_normal(q.shape)
    record = replace(empty, signals={"q": q + noise})
    case = cases.prepare(Forward(forward.model, [record]), [record], [])
    assert evidence.rms(case.bare([])) > 1.5 * evidence.rms(case.kept().whitened([]))
    assert evidence.rms(case.kept().whitened([])) < 1.1


LOOPS = {
    "pid": {"kp": 8.0, "kd": 0.6, "ki": 20.0},
    "cascade": {"kd": 0.6, "position_gain": 12.0, "speed_ki": 3.0, "speed_feed": 0.5},
}


@pytest.fixture(params=LOOPS)
def lifted(request, tmp_path):
    """Function that makes recordings of a rod that is lifted by a drive with an integrator."""
    urdf = (robot.load("servo_pendulum").folder / "servo_pendulum.urdf").read_text()
    (tmp_path / "rod.urdf").write_text(urdf)
    drive = {"kind": "impedance", **LOOPS[request.param]}
    about = {"urdf": "rod.urdf", "joints": ["pivot"], "fixed_base": True, "standing": [0.8],
             "control_rate": 100, "drives": {"pivot": drive}}  # fmt: skip
    (tmp_path / "robot.yaml").write_text(yaml.safe_dump(about))
    model, rng = Model(str(tmp_path)), np.random.default_rng(4)

    def make(first, effects=(), rest=0.0, window=0.0, torque=0.0, overrides=None):
        t, made = np.arange(700) / 100.0, []
        for at in (0.0, 1.0):
            told = 0.8 + 0.3 * np.sin(4.0 * t + at) * (t > rest)
            command = {"position": told[:, None]}
            q = np.full((len(t), 1), 0.8)
            empty = Record("r", t, command, ("pivot",), {"q": q, "tau": q}, ("pivot",))
            forward = Forward(model, [empty])
            forward._starts = [[Start(0, len(t), np.array([0.8]), np.zeros(1))]]
            (said,) = forward(effects, overrides, step=1 / 8)
            q, tau = np.split(said, 2, axis=1)
            signals = {"q": q + 1e-4 * rng.standard_normal(q.shape)}
            if torque:
                signals["tau"] = tau + torque * rng.standard_normal(q.shape)
            made.append(replace(empty, signals=signals).rows(first, first + 400))
        return cases.prepare(Forward(model, made, ForwardParams(window=window)), made[:1], made[1:])

    return make


@pytest.mark.parametrize(
    ("first", "rest"), [(0, 0.0), (137, 0.0), (220, 0.0), (200, 2.5)],
    ids=["switched on", "moving", "turning", "at rest under load"],
)  # fmt: skip
def test_what_an_integrator_holds_when_a_record_begins_is_no_gap(lifted, first, rest):
    case = lifted(first, rest=rest)
    again = copy(case.forward)()
    assert all(
        np.array_equal(*pair, equal_nan=True) for pair in zip(case.forward(), again, strict=True)
    )
    other = replace(case, forward=copy(case.forward), loose=None)
    other.forward._starts = [
        [s._replace(integral=0.0) for s in each] for each in case.forward.starts
    ]
    assert evidence.rms(case.kept().whitened([])) < 1.1
    if first:
        assert evidence.rms(other.bare([])) > 30.0
    else:
        assert all(each[0].integral == 0.0 for each in case.forward.starts)


@pytest.mark.parametrize("first", [0, 137], ids=["switched on", "moving"])
def test_what_an_integrator_holds_when_a_piece_begins_is_no_gap(lifted, first):
    case = lifted(first, window=0.5)
    other = replace(case, forward=copy(case.forward), loose=None)
    other.forward._starts = [
        [s._replace(integral=0.0) for s in each] for each in case.forward.starts
    ]
    assert len(case.forward.starts[0]) == 8
    assert evidence.rms(case.kept().whitened([])) < 3.0  # each piece begins in a measured speed
    assert evidence.rms(other.bare([])) > 100.0


@pytest.mark.parametrize(
    ("effects", "overrides"),
    [
        ([{"name": "torque_constant_error", "error": 0.18}], {}),
        ([{"name": "torque_constant_error", "error": -0.3}], {}),
        ([], {"bodies.rod.mass": 0.6}),
    ],
    ids=["stronger motor", "weaker motor", "heavier"],
)
@pytest.mark.parametrize("torque", [0.0, 1e-3], ids=["", "torque measured"])
def test_an_integrator_has_wound_up_by_the_motor_and_the_mass_that_there_are(
    lifted, effects, overrides, torque
):
    """The true model follows a record from its first row, before anything is refitted."""
    case = lifted(200, effects, rest=2.5, torque=torque, overrides=overrides)
    assert evidence.rms(case.bare([])) > 10.0
    assert evidence.rms(case.bare(effects, overrides)) < 1.3


@pytest.mark.parametrize(("share", "wound"), [(0.9, False), (0.52, True), (0.1, True)])
def test_a_drive_was_just_switched_on_only_where_that_is_clearly_better(lifted, share, wound):
    """Where neither start fits, the one that is a little nearer tells nothing."""
    forward = lifted(200, rest=2.5).forward
    begun = forward.starts
    empty = copy(forward)
    empty._starts = [[s._replace(integral=0.0) for s in each] for each in begun]
    forward.measured = [
        share * none + (1.0 - share) * full
        for none, full in zip(empty(), copy(forward)(), strict=True)
    ]
    assert all(np.any(each[0].integral) == wound for each in forward._switched_on())


def test_a_measured_torque_tells_what_an_integrator_holds_whatever_acts_beside_the_drive(lifted):
    """A spring that the given model lacks, where inverse dynamics takes its torque for held."""
    beside = [{"name": "added_stiffness", "stiffness": 1.5}]
    case = lifted(220, beside)
    told = lifted(220, beside, torque=0.05)
    positions = [rows[:, :1] for rows in told.bare(beside)]
    assert evidence.rms(case.bare(beside)) > 8.0 * evidence.rms(positions)


def test_an_effect_is_told_from_what_an_integrator_holds(lifted):
    """Friction holds a part of the weight of the rod, too."""
    rubs = [{"name": "coulomb_friction", "torque": 0.05}]
    case = lifted(137, rubs)
    assert evidence.rms(case.suited([], {})[0]) > 5.0
    assert evidence.rms(case.relined(rubs).suited(rubs, {})[0]) < 1.2


@pytest.mark.parametrize(
    ("first", "most", "unloaded"), [(320, 1.3, 10.0), (150, 2.5, 3.0)], ids=["at rest", "moving"]
)  # a moving joint's acceleration is known less well
def test_friction_that_springs_back_holds_a_joint_when_a_record_begins(
    first, most, unloaded, tmp_path
):
    """A rod that comes to rest where its drive does not want it stays there until it is moved."""
    urdf = (robot.load("servo_pendulum").folder / "servo_pendulum.urdf").read_text()
    (tmp_path / "rod.urdf").write_text(urdf)
    about = {"urdf": "rod.urdf", "joints": ["pivot"], "fixed_base": True, "standing": [0.0],
             "control_rate": 100,
             "drives": {"pivot": {"kind": "impedance", "kp": 8.0, "kd": 0.6}}}  # fmt: skip
    (tmp_path / "robot.yaml").write_text(yaml.safe_dump(about))
    model, t = Model(str(tmp_path)), np.arange(800) / 100.0
    told = 0.5 + 0.3 * np.sin(4.0 * np.where(t < 3.0, t, np.maximum(t - 1.0, 3.0)))
    rubs = [{"name": "hysteresis", "torque": 0.4, "stroke": 0.1}]
    empty = Record(
        "r", t, {"position": told[:, None]}, ("pivot",), {"q": told[:, None]}, ("pivot",)
    )
    (q,) = Forward(model, [empty])(rubs, step=1 / 8)
    noise = 1e-4 * np.random.default_rng(1).standard_normal(q.shape)
    record = replace(empty, signals={"q": q + noise}).rows(first, first + 400)
    case = cases.prepare(Forward(model, [record]), [record], [])
    other = replace(case, forward=copy(case.forward), loose=None)
    other.forward._runs = OrderedDict()
    other.forward._starts = [[s._replace(needed=np.nan) for s in case.forward.starts[0]]]
    assert evidence.rms(case.relined(rubs).kept().whitened(rubs)) < most
    assert evidence.rms(other.bare(rubs)) > unloaded


@pytest.mark.parametrize("most", [np.inf, 2.5], ids=["free", "within bounds"])
def test_a_held_out_record_that_repeats_a_fitted_one_begins_as_that_does(most):
    """Held-out records do not determine the robot, but their starts suit what is found of it."""
    rng, rows = np.random.default_rng(5), np.ones(40, dtype=bool)
    changes = [np.asarray(rng.standard_normal((40, 2))) for _ in range(5)]
    columns = loose.Columns.of((40, 2), [loose.Response.of(each) for each in changes])
    residual = 3.0 * rng.standard_normal((40, 2)) + changes[0] - changes[3]
    two = loose.Loose(
        ("a", "b"), np.zeros(2), np.ones(2), np.tile([-9.0, 9.0], (2, 1)), np.arange(2),
        (columns, columns), np.ones(2), (rows, ~rows), (~rows, rows), most, np.array([0.5, 0.0]),
        np.ones(2, dtype=bool),
    )  # fmt: skip
    both = two.best([residual, residual], [0, 1])
    alone = two.best([residual], [0])
    assert np.max(np.abs(both[0] - two.at)) > 0.2
    assert all(np.allclose(a, b) for a, b in zip(both, alone, strict=False))
    assert np.allclose(both[2], both[1])


def test_deviations_stay_within_what_is_believed():
    rng = np.random.default_rng(3)
    for _ in range(20):
        a = rng.standard_normal((12, 6))
        gram, moment = a.T @ a + np.eye(6), 8.0 * rng.standard_normal(6)
        x = loose._within(gram, moment, (-np.ones(6), np.ones(6)))
        slope = gram @ x - moment
        assert np.all(np.abs(x) <= 1.0)
        inside = np.abs(x) < 1.0 - 1e-9
        assert np.allclose(slope[inside], 0.0, atol=1e-6)
        assert np.all(slope[~inside] * x[~inside] <= 1e-6)  # pushes outwards


@pytest.mark.parametrize("size", [2, 5, 40])
def test_no_way_within_bounds_leads_below_the_best_deviations(size):
    """A value that ran into its bound comes back once those that drove it there have moved."""
    rng, limits = np.random.default_rng(size), np.full(size, 2.5)
    for _ in range(100):
        columns = rng.normal(size=(3 * size, size)) @ rng.normal(size=(size, size))
        gram, moment = columns.T @ columns + np.eye(size), columns.T @ rng.normal(size=3 * size)
        best = loose._within(gram, 30.0 * moment, (-limits, limits))
        slope = gram @ best - 30.0 * moment
        inward = np.where(best >= limits, slope, np.where(best <= -limits, -slope, abs(slope)))
        assert np.all(abs(best) <= limits)
        assert inward.max() <= 1e-5 * np.abs(30.0 * moment).max()


def test_what_no_straight_line_tells_is_sought_by_simulation(servo):
    """A drive that rounds its encoder: straight lines ended at a rod far too heavy."""
    case = servo()
    straight, _ = case._refitted([], {}, [0, 1], exact=True)
    left, values, *_, hope = case.suited([], {})
    assert evidence.rms(left) < 0.9 * evidence.rms(straight) and hope == 1.0
    first, *_, hope = case.suited([], {}, seek=False)
    assert evidence.rms(first) > 1.1 * evidence.rms(left) and hope < 1.0
    found = [values[name] / value for name, value in servo.truth.items()]
    assert found == pytest.approx([1.0, 1.0], abs=0.01)


def test_what_is_left_is_known_without_going_through_the_records_again(slide):
    case = of(slide, [FRICTION])
    near, every = case.loose, list(range(len(case.records)))
    for record in every:  # as where a part of each judges, and the rest is fitted
        near.rows[record][len(near.rows[record]) // 2 :] = False
        near.judges[record][:] = ~near.rows[record]
    near = replace(near, grams={})
    residuals = case.bare([], near.values(near.at))
    seen = [near._products(i, r) for i, r in zip(every, residuals, strict=True)]
    by = near._solved(seen, every, near.weight)
    left = near.left(residuals, every, by)
    squares = np.sum([np.nansum(np.square(r), axis=0) for r in left], axis=0)
    assert near._power(seen, every, by) == pytest.approx(squares, rel=1e-9)
    assert np.any(by[0] != 0.0)


def test_parts_that_are_not_0_give_the_sums_of_the_whole_matrix():
    rng = np.random.default_rng(5)
    dense = rng.normal(size=(30, 6, 5))
    dense[:, :3, 3:] = dense[:, 3:, :2] = dense[:, 5] = 0.0  # two legs, and a channel that rests
    responses = [loose.Response.of(change) for change in np.moveaxis(dense, -1, 0)]
    assert sum(response.values.size for response in responses) < 0.6 * dense.size
    found = loose.Columns.of(dense.shape[:2], responses)
    r, used = rng.normal(size=(30, 6)), rng.random((30, 6)) < 0.7
    x = rng.normal(size=5)
    np.testing.assert_allclose(found.by(x), dense @ x, atol=1e-12)
    np.testing.assert_allclose(found.moment(r), np.einsum("tck,tc->ck", dense, r), atol=1e-12)
    wanted = np.einsum("tci,tcj,tc->cij", dense, dense, used.astype(float))
    np.testing.assert_allclose(found.gram(used), wanted, atol=1e-12)
    assert sum(block.values.size for block in found.blocks) < 0.6 * dense.size


def test_what_drives_do_to_a_model_with_a_large_effect_is_simulated_about_it(slide):
    """A brake as large as the drive's own: a weaker drive moves that carriage otherwise."""
    brake = [{"name": "viscous_friction", "damping": 60.0}]
    case = of(slide, brake)
    weaker = np.array([0.0, 0.0, -1.0])
    here, there = (case.bare(brake, case.loose.values(by)) for by in (0.0 * weaker, weaker))

    def missed(near):
        """Part of the change that straight lines miss."""
        every = range(len(here))
        predicted = near.left(here, every, [near.at + weaker, *near.unmoved(every)[1:]])
        change = [(b - a, b - p) for a, b, p in zip(here, there, predicted, strict=True)]
        return evidence.rms([left for _, left in change]) / evidence.rms(
            [whole for whole, _ in change]
        )

    about_bare, about_itself = missed(case.loose), missed(loose.of_model(case, brake))
    assert about_itself < 0.1 < 0.3 < about_bare


@pytest.mark.parametrize(
    ("name", "deviation", "true"),
    [
        ("bodies.rod.inertia", "200%", 0.001),
        ("drives.pivot.stall_torque", "60%", 0.3),
        ("masses.rod", 0.1, 0.05),
    ],
)
def test_no_value_goes_where_no_robot_can_be_built(servo, name, deviation, true):
    """An inertia uncertain by half of it went below nothing, and the robot could not be run."""
    t = np.arange(200) / 100.0
    q = 0.6 * np.sin(6.0 * t)[:, None]
    empty = Record("r", t, {"position": q}, ("pivot",), {"q": q}, ("pivot",))
    model = Model("servo_pendulum", {"drives.pivot.resolution": 0.0})
    (seen,) = Forward(model, [empty])(overrides={name: true})
    record = replace(empty, signals={"q": seen})
    unsure = Model(model.robot, {**model.overrides, f"uncertain.{name}": deviation})
    forward = Forward(unsure, [record])
    near = cases.prepare(forward, [record], []).loose
    index = near.names.index(name)
    for side in near.reach:
        values = near.values(side)
        assert values[name] >= loose.MIN_RATIO * near.nominal[index] * (1.0 - 1e-9)
        assert np.isfinite(forward(overrides=values)[0]).all()


@pytest.mark.parametrize("off", [1.3, 1.4])
def test_a_drive_that_is_off_runs_with_values_that_are_far_off(slide, off):
    """A mass far off, known to a fifth, beside a drive known to little: the robot was refused."""
    fit, judge = slide.records(overrides={"bodies.carriage.mass": off})
    unsure = Model(slide.model.robot, {"uncertain.bodies.*.mass": "20%"})
    case = cases.prepare(Forward(unsure, [*fit, *judge]), fit, judge)
    assert case.loose.at.any() and "torque_constant_error.slide" in case.loose.names
    for effects in ([], [FRICTION]):
        left = case.corrected(effects, {}).whitened(effects)
        assert evidence.rms(left) < evidence.LIMIT  # it ran
    off, put_right = case.kept().whitened([]), case.suited([], {})[0]
    assert evidence.closed_by(off, put_right) > 0.9


def test_a_drive_that_is_off_is_an_effect_wherever_a_model_runs(slide):
    fit, _ = slide.records()
    forward = Forward(slide.model, fit)
    (a, b), (c, d) = (
        forward(overrides={"torque_constant_error.slide": -0.2}),
        forward([{"name": "torque_constant_error", "joint": "slide", "error": -0.2}]),
    )
    assert np.array_equal(a, c) and np.array_equal(b, d)
    assert forward.given({"torque_constant_error.slide": -0.2}).drives == forward.given().drives
