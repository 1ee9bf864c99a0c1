# SPDX-License-Identifier: Apache-2.0
"""Phases, closing schedule, learning and weight files of the reflex network."""

import dataclasses
import json

import numpy as np
import pytest

from loco_control.exceptions import MissingFileError, NameUnknownError, ParameterError
from loco_learning.params import OUTPUT_JOINTS, PHASES, SCALINGS, LearnerParams
from loco_learning.reflex.network import ReflexNetwork
from loco_learning.reflex.senses import FootForces

DT = 0.004
SHORT = {"memory": 75, "neurons": 60, "stand": 0.1, "train": 3.0, "closing": 2.0, "test": 1.0}
END = 1525  # ticks of SHORT


def network(seed=0, **changes):
    params = LearnerParams(**{**SHORT, **changes})
    return ReflexNetwork(params, FootForces(params), DT, seed)


def column(answers, name):
    return np.array([getattr(learning, name) for _, learning in answers])


def test_phases_follow_each_other_at_their_times(drive):
    answers = drive(network(), 0, END + 10)
    phase = column(answers, "phase")
    np.testing.assert_array_equal(np.flatnonzero(np.diff(phase)) + 1, [25, 775, 1275])
    assert phase[0] == PHASES.index("stand")
    assert phase[-1] == PHASES.index("test")  # goes on after its end
    assert [PHASES[network().phase_at(t)] for t in (0.0, 0.1, 3.1, 5.1)] == list(PHASES)


def test_a_phase_of_no_length_is_skipped(drive):
    phase = column(drive(network(closing=0.0), 0, 800), "phase")
    assert PHASES.index("closing") not in phase
    assert phase[-1] == PHASES.index("test")


def test_target_drives_until_closing_then_the_prediction_does(drive):
    from ..conftest import target_at

    answers = drive(network(), 0, END)
    for command, learning in answers:
        target = target_at(command.tick)
        hips = np.arange(0, 12, 3)
        np.testing.assert_array_equal(command.q[hips], target.q[hips])
        np.testing.assert_array_equal(command.dq[hips], target.dq[hips])
        assert learning.driving == (learning.phase >= PHASES.index("closing"))
        wanted = np.concatenate([target.q[OUTPUT_JOINTS], target.dq[OUTPUT_JOINTS]])
        sent = np.concatenate([command.q[OUTPUT_JOINTS], command.dq[OUTPUT_JOINTS]])
        np.testing.assert_array_equal(sent, learning.prediction if learning.driving else wanted)
        rms = np.sqrt(np.mean((learning.prediction[:8] - wanted[:8]) ** 2))
        assert learning.error == pytest.approx(rms, abs=1e-12)


def test_learning_fades_in_closing_from_the_end_of_each_block(drive):
    answers = drive(network(), 0, END)
    learning = column(answers, "learning")
    assert learning[25:775].all()
    assert not learning[:25].any()
    assert not learning[1275:].any()
    ticks = np.arange(775, 1275)
    rho = (ticks - 775) / 500
    np.testing.assert_array_equal(learning[775:1275], ticks % 10 < 10 * (1 - rho))
    assert learning[775:825].all()  # nothing is left out before rho reaches a tenth
    assert learning[775:1275].mean() == pytest.approx(0.55, abs=0.02)


def test_it_learns_the_fake_trot(drive):
    answers = drive(network(), 0, END)
    error = column(answers, "error")
    assert error[1275:].max() < 0.01  # of a stroke of 0.7 rad
    hasty = column(drive(network(train=0.1, closing=0.0), 0, 400), "error")
    assert hasty[75:].mean() > 10.0 * error[1275:].mean()
    norm = column(answers, "weight_norm")
    assert norm[0] == 0.0
    np.testing.assert_array_equal(norm[1275:], norm[1274])


@pytest.mark.parametrize("scaling", SCALINGS)
def test_same_seed_same_bits_and_reset_starts_again(drive, scaling):
    first = network(3, scaling=scaling)
    before = drive(first, 0, 1300)
    first.reset()
    for other in (drive(first, 0, 1300), drive(network(3, scaling=scaling), 0, 1300)):
        for name in ("prediction", "error", "weight_norm"):
            np.testing.assert_array_equal(column(other, name), column(before, name))
    different = column(drive(network(4, scaling=scaling), 0, 1300), "prediction")
    assert not np.array_equal(different, column(before, "prediction"))


def test_messages_are_not_touched_later(drive):
    answers = drive(network(), 0, 800)
    kept = [(c.q.copy(), learning.prediction.copy()) for c, learning in answers]
    made = network()
    again = drive(made, 0, 800)
    drive(made, 800, 900)
    for (q, prediction), (command, learning) in zip(kept, again, strict=True):
        np.testing.assert_array_equal(q, command.q)
        np.testing.assert_array_equal(prediction, learning.prediction)


def test_disabled_passes_the_target_through(drive):
    from ..conftest import target_at

    for command, learning in drive(network(enabled=False), 0, END):
        np.testing.assert_array_equal(command.q, target_at(command.tick).q)
        assert not (learning.driving or learning.learning)
        assert learning.weight_norm == 0.0


@pytest.mark.parametrize("scaling", SCALINGS)
@pytest.mark.parametrize("tick", [0, 400, 1000, 1400])
def test_a_saved_network_goes_on_bit_by_bit(drive, tmp_path, scaling, tick):
    made = network(5, scaling=scaling, hidden_bias=1.0, memory=20, neurons=15)
    drive(made, 0, tick)
    made.save(tmp_path / "net.npz")
    loaded = ReflexNetwork.load(tmp_path / "net.npz")
    assert (loaded.params, loaded.dt, loaded.seed) == (made.params, made.dt, made.seed)
    expected, got = drive(made, tick, END), drive(loaded, tick, END)
    for (command, learning), (command_2, learning_2) in zip(expected, got, strict=True):
        np.testing.assert_array_equal(command.q, command_2.q)
        np.testing.assert_array_equal(learning.prediction, learning_2.prediction)
        assert learning.weight_norm == learning_2.weight_norm


def test_weights_from_a_file_drive_the_test_phase_and_never_change(drive, tmp_path):
    path = tmp_path / "deep" / "net.npz"
    trained = network(5)
    drive(trained, 0, 1300)
    trained.save(path)
    reuse = network(99, weights=str(path), train=1.0, closing=0.0)
    answers = drive(reuse, 0, 1000)
    assert not column(answers, "learning").any()
    np.testing.assert_array_equal(np.diff(column(answers, "weight_norm")), 0.0)
    assert column(answers, "driving")[275:].all()
    assert column(answers, "error")[275:].max() < 0.01
    reuse.reset()
    np.testing.assert_array_equal(
        column(drive(reuse, 0, 1000), "prediction"), column(answers, "prediction")
    )


def test_a_weight_file_that_does_not_fit_is_refused(drive, tmp_path):
    path = tmp_path / "net.npz"
    network(neurons=10).save(path)
    with pytest.raises(ParameterError, match="learner.neurons is 12.*have 10"):
        network(neurons=12, weights=str(path))
    with pytest.raises(MissingFileError, match="nowhere.npz"):
        network(weights=str(tmp_path / "nowhere.npz"))


def rewrite(path, **changes):
    with np.load(path) as file:
        arrays = dict(file)
    meta = json.loads(str(arrays.pop("meta")))
    arrays.update({k: v for k, v in changes.items() if k != "format"})
    meta["format"] = changes.get("format", meta["format"])
    np.savez(path, meta=json.dumps(meta), **arrays)


def test_broken_weight_files_are_refused(tmp_path):
    path = tmp_path / "net.npz"
    path.write_text("not a zip")
    with pytest.raises(ParameterError, match="is not a weights file"):
        ReflexNetwork.load(path)
    network(neurons=10).save(path)
    rewrite(path, format=99)
    with pytest.raises(ParameterError, match="weights file of format 99; wanted is .* format 1"):
        ReflexNetwork.load(path)
    network(neurons=10).save(path)
    rewrite(path, **{"readout.weights": np.zeros((3, 16))})
    with pytest.raises(ParameterError, match=r"shape \(3, 16\) for readout.weights"):
        ReflexNetwork.load(path)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"memory": 0}, r"memory must be in \[1, 1000\]"),
        ({"neurons": 2.5}, "neurons must be a whole number"),
        ({"regularisation": 0.0}, "regularisation must be in"),
        ({"stand": 0.0, "train": 0.0, "closing": 0.0, "test": 0.0}, "longer than 0 s"),
    ],
)
def test_bad_parameters_are_refused(changes, message):
    with pytest.raises(ParameterError, match=message):
        LearnerParams(**changes)


def test_an_unknown_activation_names_the_known_ones():
    with pytest.raises(NameUnknownError, match="relu, tanh"):
        LearnerParams(activation="sigmoid")


def test_relu_learns_as_well(drive):
    error = column(drive(network(activation="relu"), 0, END), "error")
    assert error[1275:].max() < 0.03


def test_params_describe_themselves():
    for f in dataclasses.fields(LearnerParams):
        assert f.metadata["doc"]
