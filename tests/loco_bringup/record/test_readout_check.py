# SPDX-License-Identifier: Apache-2.0
"""The readout check passes on a real run, and on nothing that only looks like one."""

import numpy as np
import pytest

from loco_bringup.bag.reader import Bag
from loco_bringup.logs.bag_log import read_log
from loco_bringup.logs.rollout_bag import run_rollout, write_log
from loco_bringup.record.readout_check import check_log, check_readout, weights_of
from loco_control.exceptions import BagError, MissingFileError
from loco_learning.runs.experiment import override


@pytest.fixture(scope="module")
def bag(short, tmp_path_factory):
    folder = tmp_path_factory.mktemp("readout") / "run"
    run_rollout(short, folder, lambda progress: None)
    return Bag(folder)


@pytest.fixture(scope="module")
def log(bag):
    return read_log(bag)


@pytest.fixture(scope="module")
def weights(bag):
    return weights_of(bag)


def test_the_network_run_again_gives_the_recorded_commands_bit_by_bit(bag, log):
    check = check_readout(bag.folder)
    assert check.drives
    assert check.error == 0.0
    assert check.abduction == 0.0  # HAA alone follows the target
    test = log.phase_of("test")
    np.testing.assert_array_equal(check.t, log.t[test][1:])
    assert check.target_distance.min() > 1e-4  # no tick could come from the target
    assert "the readout drives HFE and KFE" in check.summary()
    assert "\n" not in check.summary()


def test_no_flag_and_no_prediction_of_the_bag_is_read(log, weights):
    silent = log.changed(
        driving=np.zeros_like(log.driving),
        phase=np.zeros_like(log.phase),
        prediction=np.full_like(log.prediction, np.nan),
    )
    assert check_log(silent, weights).drives


def test_a_target_that_drives_does_not_pass(log, weights):
    check = check_log(log.changed(command=log.target, command_dq=log.target_dq), weights)
    assert not check.drives
    assert check.target_distance.max() == 0.0
    assert "does NOT drive" in check.summary()


def test_one_command_that_is_a_hair_off_does_not_pass(log, weights):
    q = log.command.copy()
    q[-3, 4] += 1e-6
    assert not check_log(log.changed(command=q), weights).drives


def test_other_forces_give_other_commands(log, weights):
    grf = log.grf.copy()
    grf[log.phase_of("test").start + 5, 0, 2] += 50.0
    assert check_log(log.changed(grf=grf), weights).error > 1e-6


def test_a_network_of_another_seed_does_not_pass(log, short, tmp_path):
    run_rollout(override(short, {"seed": 5}), tmp_path / "other", lambda progress: None)
    assert not check_log(log, weights_of(Bag(tmp_path / "other"))).drives


def test_a_bag_without_network_says_so(short, tmp_path):
    open_loop = override(short, {"learner.enabled": False, "duration": 0.1})
    run_rollout(open_loop, tmp_path / "open", lambda progress: None)
    with pytest.raises(BagError, match=r"open_0\.mcap carries no weights\.npz"):
        check_readout(tmp_path / "open")


def test_a_network_that_is_switched_off_says_so(short, tmp_path):
    run_rollout(override(short, {"learner.enabled": False}), tmp_path / "off", lambda p: None)
    with pytest.raises(BagError, match="open loop"):
        check_readout(tmp_path / "off")


def test_a_run_that_ends_before_test_says_so(log, weights):
    with pytest.raises(BagError, match="no test phase"):
        check_log(log.cut(slice(0, log.phase_of("test").start)), weights)


def test_a_missing_tick_is_named(log, weights):
    gap = int(log.ticks()[-10])
    columns = {name: np.delete(values, -10, axis=0) for name, values in log.columns.items()}
    with pytest.raises(BagError, match=f"tick {gap} of the test phase"):
        check_log(log.changed(**columns), weights)


def test_a_broken_network_file_is_named(log):
    with pytest.raises(BagError, match=r"the bag's weights\.npz"):
        check_log(log, b"no zip file")


def test_a_bag_that_is_not_there(tmp_path):
    with pytest.raises(MissingFileError, match="no bag at"):
        check_readout(tmp_path / "nowhere.mcap")


def test_a_bag_written_again_from_its_log_passes_as_well(log, weights, tmp_path):
    (tmp_path / "copy").mkdir()
    (tmp_path / "copy" / "weights.npz").write_bytes(weights)
    write_log(log, tmp_path / "copy")
    assert check_readout(tmp_path / "copy").error == 0.0
