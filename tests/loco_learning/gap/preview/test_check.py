# SPDX-License-Identifier: Apache-2.0
"""What shows in recordings: sizes that are promised show, and what nothing excites does not."""

import math
import subprocess
import sys
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from loco_learning.gap.fitting.params import GapParams
from loco_learning.gap.fitting.search import call
from loco_learning.gap.hypotheses.bundles import Batch
from loco_learning.gap.importing import observe
from loco_learning.gap.prediction.forward import Forward
from loco_learning.gap.preview import check, visible
from loco_learning.gap.recordings.tracks import Track
from loco_learning.gap.setup.bench import busiest
from loco_learning.jobs import pool
from loco_sim.bolted import kernels
from loco_sim.robot import robot

SHOWS = 0.75


@pytest.fixture(scope="module")
def found(slide):
    fit, judge = slide.records()
    return check.inspect(slide.model, [*fit, *judge])


def repeated(record, count):
    """A recording that does the same again and again."""
    values = {
        part: {k: np.tile(v, (count, 1)) for k, v in getattr(record, part).items()}
        for part in ("command", "signals")
    }
    return replace(record, t=record.dt * np.arange(count * len(record.t)), **values)


@pytest.fixture
def short(monkeypatch):
    """A preview that looks at a second and a half of the recordings."""
    monkeypatch.setattr(check, "EFFORT", check.EFFORT.replace(total_max=1.5))


@pytest.fixture
def steps(monkeypatch):
    """Function that counts the physics steps of a preview."""
    run, counted = kernels.run, []

    def counting(orders, out, memories):
        counted.append(np.diff(orders.segments).sum() * len(orders.which) // len(out))
        return run(orders, out, memories)

    def count(*inputs):
        counted.clear()
        check.inspect(*inputs)
        return sum(counted)

    monkeypatch.setattr(kernels, "run", counting)
    return count


def of(found, effect, variant=""):
    return [r for r in found["effects"] if r["effect"] == effect and r["variant"] == variant]


@pytest.mark.parametrize("effect", ["coulomb_friction", "viscous_friction", "sensor_gain"])
def test_an_effect_of_the_smallest_size_adds_as_much_as_shows(bench, effect):
    case, bundles = bench([])
    case = replace(case, fit_rows=[np.ones(len(r.t), dtype=bool) for r in case.records])
    with pool.start(call, (case,)) as tasks:
        (one,), seconds = visible.visible_sizes(
            case, [bundles[effect]], SHOWS, tasks, lambda share: None
        )
    assert seconds > 0.0
    (h,) = bundles[effect].hypotheses
    c = h.coordinates[0]
    at = [0.0 if k.strength else k.start[0] for k in h.coordinates]
    at[0] = one.smallest / c.size
    change = case.vector([h.term(at).spec], coarse=True) - case.vector((), coarse=True)
    channels = case.channel_of()
    rms = max(np.sqrt(np.mean(change[channels == k] ** 2)) for k in np.unique(channels))
    assert rms == pytest.approx(SHOWS, rel=0.3)
    assert one.seen == (visible.YES if one.smallest <= one.typical else visible.LARGE)


def test_what_cannot_act_does_not_show(found):
    (roll,) = [r for r in of(found, "slope") if r["parameter"] == "roll"]  # across the slide
    assert roll["seen"] == "no" and roll["alike"] == []
    assert {r["seen"] for r in of(found, "coulomb_friction")} == {"yes"}


def test_a_slide_is_told_in_newtons(found):
    assert of(found, "coulomb_friction")[0]["unit"] == "N"


def test_look_alikes_are_mutual(found):
    alike = {
        r["effect"]: set(r["alike"]) for r in found["effects"] if len(of(found, r["effect"])) == 1
    }
    pairs = [(a, b) for a, names in alike.items() for b in names if b in alike]
    assert pairs
    assert all(a in alike[b] for a, b in pairs)


def test_any_number_of_workers_says_the_same(slide, found):
    fit, judge = slide.records()
    shares = []
    again = check.inspect(
        slide.model, [*fit, *judge], progress=lambda share, stage: shares.append(share), workers=2
    )
    assert shares == sorted(shares) and max(np.diff(shares)) < 0.2  # it is seen to go on
    assert {k: v for k, v in again.items() if k != "search_seconds"} == {
        k: v for k, v in found.items() if k != "search_seconds"
    }


def test_an_effect_that_the_robot_cannot_have_says_why(bench):
    case, bundles = bench([])
    (h,) = bundles["coulomb_friction"].hypotheses
    wrong = replace(h, fixed=(("joint", "nowhere"),))
    base = case.vector((), coarse=True)
    one, two = visible.try_bundle(case, Batch((wrong, h), (None, None)), SHOWS, base)
    assert "nowhere" in one.failed and not two.failed
    assert math.isinf(one.smallest()) and two.smallest() > 0.0


def test_a_joint_that_nothing_moves_is_missing(slide):
    fit, judge = slide.records()
    robot = slide.model.make_robot()
    record = replace(fit[0], signals={"q": 1e-4 * fit[0].signals["q"]})
    assert any("slide: no experiment moves it" in line for line in check.missing([record], [robot]))
    assert not any("moves" in line for line in check.missing([record, *judge], [robot, robot]))


def test_a_free_robot_wants_an_imu_and_a_recording_in_the_air(slide):
    (record, *_), _ = slide.records()
    robot = slide.model.make_robot()
    free = replace(robot, fixed_base=False)
    told = " ".join(check.missing([record], [free]))
    assert "no IMU" in told and "no recording in the air" in told
    gyro = replace(record, signals={**record.signals, "gyro": np.ones((len(record.t), 3))})
    told = " ".join(check.missing([gyro, record], [free, robot]))
    assert "no IMU" not in told and "no recording in the air" not in told


@pytest.mark.parametrize("height", [0.0, 5.0])
def test_a_bolted_robot_that_may_touch_the_ground_is_tested_less_and_that_is_told(slide, height):
    told = check.untested([replace(slide.model.make_robot(), height=height)])
    assert len(told) == (height == 0.0)
    assert all("not tested: it may touch the ground" in line for line in told)


def test_a_joint_without_a_sensor_is_missing(slide):
    (record, *_), _ = slide.records()
    robot = slide.model.make_robot()
    robot = replace(robot, joints=("another", *robot.joints), standing=np.r_[0.0, robot.standing])
    told = " ".join(check.missing([record], [robot]))
    assert "another: position not measured" in told


def test_stamps_are_told_as_they_came():
    rng = np.random.default_rng(1)
    t = np.arange(1000) * 0.01
    late = t + 0.0005 * rng.standard_normal(1000)
    kept = np.delete(np.arange(1000), [100, 101, 500])
    told = observe.stamps([Track("q", "hinge", late[kept], np.sin(t)[kept], "")])["q"]
    assert told["missing"] == 3.0
    assert told["jitter_ms"] == pytest.approx(0.5, rel=0.15)
    assert told["rate"] == pytest.approx(100.0, rel=0.01)
    assert told["silence"] == pytest.approx(0.03, abs=0.003)


def test_the_part_that_is_simulated_moves_most(slide):
    (record, _), _ = slide.records()
    quiet = replace(
        record, signals={"q": np.where(record.t[:, None] < 1.0, 0.0, record.signals["q"])}
    )
    (part,) = check.excerpts([quiet], 0.8)
    assert part.duration == pytest.approx(0.8, abs=0.02)
    assert np.ptp(part.signals["q"]) == pytest.approx(np.ptp(quiet.signals["q"]), rel=0.1)


def test_settings_of_the_search_change_its_time(slide, found):
    fit, judge = slide.records()
    longer = check.inspect(slide.model, [*fit, *judge], GapParams(finalists=40, evaluations=180))
    assert longer["search_seconds"][0] > 2.0 * found["search_seconds"][0]
    assert found["search_seconds"][0] < found["search_seconds"][1]


def test_a_search_takes_longer_where_effects_take_longer_to_try(slide, monkeypatch):
    fit, judge = slide.records()
    tried, told = visible.visible_sizes, []
    for slower in (1.0, 3.0):

        def look(*args, by=slower):
            rows, _ = tried(*args)
            return rows, by

        monkeypatch.setattr(visible, "visible_sizes", look)
        told.append(check.inspect(slide.model, [*fit, *judge])["search_seconds"][0])
    assert told[1] == pytest.approx(3.0 * told[0], rel=0.1)


def test_a_recording_repeated_four_times_costs_no_more_steps(slide, short, steps):
    (record, _), _ = slide.records()
    once, four = (steps(slide.model, [repeated(record, n)]) for n in (3, 12))
    assert 0 < four <= once


@pytest.mark.parametrize("count", [1, 2, 3, 100])
def test_excerpts_of_many_recordings_are_as_long_as_those_of_few(slide, count):
    (record, _), _ = slide.records()
    parts = check.excerpts([record] * count, 1.5)
    assert sum(part.duration for part in parts) == pytest.approx(1.5, abs=count * record.dt)
    assert min(part.duration for part in parts) >= check.EFFORT.each_min


def test_sub_steps_shorten_excerpts(slide):
    fit, _ = slide.records()
    longer = check.EFFORT.replace(total_max=1e4)
    seconds = []
    for rate in (1000.0, 7000.0):
        model = replace(slide.model, overrides={"sim.physics_rate": rate})
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr(check, "EFFORT", longer)
            seconds.append(check._seconds(Forward(model, fit)))
    steps = [s * (rate + 250.0) for s, rate in zip(seconds, (1000.0, 7000.0), strict=True)]
    assert steps[0] == pytest.approx(steps[1])


def test_excerpts_tell_the_same_effects_and_say_so(slide, found, short):
    fit, judge = slide.records()
    brief = check.inspect(slide.model, [*fit, *judge])
    assert found["notes"] == []
    assert brief["notes"] == [
        "effects were tried on excerpts, the parts that move most: 1.5 s of 5.99 s, from 3 of 3 "
        "recordings"
    ]
    sizes = []
    for whole, part in zip(found["effects"], brief["effects"], strict=True):
        assert (whole["effect"], whole["place"]) == (part["effect"], part["place"])
        assert (whole["seen"] == "no") == (part["seen"] == "no")
        if whole["seen"] != "no":
            sizes.append(math.log(part["smallest"] / whole["smallest"]))
    assert abs(np.median(sizes)) < math.log(1.5)


def test_a_check_is_loaded_without_what_it_seldom_needs():
    """The signal package of scipy alone loads for half a second, and brings statistics."""
    code = (
        "import sys, loco_learning.gap.workflow, loco_learning.gap.preview.check;"
        "print([m for m in ('scipy.signal', 'scipy.stats', 'scipy.interpolate')"
        " if type(sys.modules.get(m, 0)).__name__ == 'module'])"
    )
    command = [sys.executable, "-c", code]
    result = subprocess.run(command, capture_output=True, text=True, check=True)
    assert result.stdout.strip() == "[]"


@pytest.mark.parametrize("every", [1, 4])
def test_the_excerpt_of_a_slow_log_is_where_it_moves(every):
    t = 0.005 * np.arange(2000)
    q = np.full((2000, 1), np.nan)
    q[::every, 0] = np.where(t > 6.0, np.sin(8.0 * (t - 6.0)), 0.0)[::every]
    record = SimpleNamespace(t=t, dt=0.005, signals={"q": q}, rows=lambda a, b: (t[a], t[b - 1]))
    first, last = busiest(record, 2.0)
    assert first > 5.9 and last - first == pytest.approx(2.0)


def test_a_search_on_the_ground_is_faster_in_mujoco_and_the_user_is_told(monkeypatch):
    monkeypatch.setattr(check, "installed", lambda: ("pybullet", "mujoco"))
    walker, bolted = robot.load("hyq"), robot.load("pendulum")
    in_engine = [replace(one, sim=replace(one.sim, engine=engine))
                 for one in (walker, bolted) for engine in ("pybullet", "mujoco")]  # fmt: skip
    assert [bool(check.engine_notes(one)) for one in in_engine] == [True, False, False, False]
