# SPDX-License-Identifier: Apache-2.0
"""The loop with the real plant and controllers: it trots, repeats, and is logged whole."""

import dataclasses

import numpy as np
import pytest

from loco_control.exceptions import DivergedError, MissingFileError, ParameterError
from loco_learning import rollout as module
from loco_learning.experiment import load
from loco_learning.log import PARTS, Log
from loco_learning.params import PHASES
from loco_learning.reflex import OUTPUT_JOINTS, ReflexNetwork
from loco_learning.rollout import build, rollout


def arrays(log):
    return {
        f"{part}.{f.name}": getattr(getattr(log, part), f.name)
        for part in PARTS
        for f in dataclasses.fields(PARTS[part])
    }


def assert_same(one, two):
    for name, array in arrays(one).items():
        np.testing.assert_array_equal(array, arrays(two)[name], err_msg=name)


def test_the_reflex_network_learns_to_trot_and_goes_on_alone(short_log):
    assert short_log.fall == ""
    assert short_log.complete
    test = short_log.cut(short_log.phase("test"))
    assert test.learning.driving.all()
    assert not test.learning.learning.any()
    target = test.target.q[:, OUTPUT_JOINTS]
    rms = np.sqrt(np.mean((test.learning.prediction[:, :8] - target) ** 2))
    assert rms < 0.1 * np.mean(np.ptp(target, axis=0))
    x = test.truth.position[:, 0]
    assert 0.5 < (x[-1] - x[0]) / (test.t[-1] - test.t[0]) / 0.25 < 1.5


def test_every_message_of_every_tick_is_in_the_log(short_log):
    assert len(short_log) == short_log.experiment.ticks
    for name, array in arrays(short_log).items():
        assert len(array) == len(short_log), name
        if array.dtype.kind == "f":
            assert np.isfinite(array).all(), name
    for part in PARTS:
        tick = getattr(short_log, part).tick
        np.testing.assert_array_equal(tick, np.arange(len(short_log)))
    np.testing.assert_allclose(short_log.t, np.arange(len(short_log)) * 0.004, atol=1e-9)


def test_phases_of_a_log_cover_it_without_overlap(short_log):
    slices = [short_log.phase(name) for name in PHASES]
    assert slices[0].start == 0
    assert slices[-1].stop == len(short_log)
    for one, two in zip(slices, slices[1:], strict=False):
        assert one.stop == two.start


def test_same_seed_same_bits_other_seed_other_bits():
    experiment = load("hyq_short", {"duration": 1.4})
    one, two = rollout(experiment), rollout(experiment)
    assert_same(one, two)
    other = rollout(experiment, seed=7)
    assert other.seed == 7
    assert not np.array_equal(one.learning.prediction, other.learning.prediction)


def test_reset_of_the_loop_is_a_new_loop():
    experiment = load("hyq_short", {"effects": [{"name": "sensor_noise", "grf": 5.0}]})
    loop = build(experiment)
    try:
        first = [loop.step()["state"].grf for _ in range(300)]
        loop.reset()
        np.testing.assert_array_equal([loop.step()["state"].grf for _ in range(300)], first)
    finally:
        loop.close()


def test_a_log_is_the_same_after_saving_and_loading(short_log, tmp_path):
    short_log.save(tmp_path / "deep" / "log.npz")
    loaded = Log.load(tmp_path / "deep" / "log.npz")
    assert_same(short_log, loaded)
    assert loaded.experiment == short_log.experiment
    assert (loaded.seed, loaded.fall) == (short_log.seed, short_log.fall)
    np.testing.assert_array_equal(loaded.reflex_time, short_log.reflex_time)


def test_broken_logs_are_refused(tmp_path):
    path = tmp_path / "log.npz"
    with pytest.raises(MissingFileError, match="log.npz"):
        Log.load(path)
    path.write_text("no")
    with pytest.raises(ParameterError, match="is not a log file of loco"):
        Log.load(path)
    np.savez(path, meta='{"kind": "log", "format": 99}')
    with pytest.raises(ParameterError, match="log file of format 99"):
        Log.load(path)


def test_weights_saved_in_one_run_drive_the_legs_in_the_next(tmp_path):
    path = str(tmp_path / "net.npz")
    seen = []
    trained = rollout(load("hyq_short"), on_tick=lambda k, _: seen.append(k), save_weights=path)
    assert seen == list(range(1, len(trained) + 1))
    changes = {"learner.weights": path, "learner.closing": 0.0, "learner.train": 2.0, "seed": 5}
    again = rollout(load("hyq_short", changes))
    assert again.fall == ""
    assert not again.learning.learning.any()
    assert again.cut(again.phase("test")).learning.driving.all()
    saved = np.linalg.norm(ReflexNetwork.load(path).readout.weights)
    np.testing.assert_allclose(again.learning.weight_norm, saved)


def test_a_fall_ends_the_run_and_says_why():
    # No stiffness, no trunk: it must collapse.
    soft = {f"impedance.{k}_kp": [1.0, 1.0, 1.0] for k in ("swing", "stance")}
    log = rollout(load("hyq_short", {**soft, "trunk.enabled": False}))
    assert log.fall
    assert not log.complete
    assert log.truth.position[-1, 2] < 0.5


def test_a_diverged_plant_counts_as_a_fall(monkeypatch):
    def diverge(self, command, trunk):
        if command.tick == 20:
            raise DivergedError("joint position is not finite")
        return original(self, command, trunk)

    original = module.Simulation.step
    monkeypatch.setattr(module.Simulation, "step", diverge)
    log = rollout(load("hyq_short"))
    assert log.fall == "joint position is not finite"
    assert len(log) == 20


def test_open_loop_never_lets_the_network_speak():
    log = rollout(load("hyq_trot_open", {"learner.train": 2.0}))
    assert not log.learning.driving.any()
    np.testing.assert_array_equal(log.command.q, log.target.q)
    np.testing.assert_array_equal(log.command.dq, log.target.dq)
