# SPDX-License-Identifier: Apache-2.0
"""Bags of standard messages are read back as the logs that were written."""

import numpy as np
import pytest

from loco_bringup.bag.reader import Bag
from loco_bringup.bag.writer import BagWriter
from loco_bringup.logs.bag_log import read_log
from loco_bringup.logs.rollout_bag import write_messages as write_log
from loco_bringup.outcome import describe
from loco_control.exceptions import BagError, NameUnknownError
from loco_control.params import to_dict
from loco_learning.params import PHASES
from loco_learning.runs.experiment import load
from loco_learning.runs.log import COLUMNS
from loco_learning.runs.rollout import rollout

CHANGES = {f"learner.{name}": 0.5 for name in ("stand", "train", "closing", "test")}


@pytest.fixture(scope="module")
def log():
    return rollout(load("tigrillo_bound_reflex", CHANGES))


def written(log, folder, rename=None, text=None):
    """Bag of a log; `rename` maps topics, None leaves one out."""
    import yaml

    writer = BagWriter(folder, describe(log.experiment))

    class Renamed:
        def add_row(self, name, row):
            if new := rename(name):
                writer.add_row(new, row)

        def write(self, name, data, stamp):
            if new := rename(name):
                writer.write(new, data, stamp)

    write_log(log, writer if rename is None else Renamed())
    writer.attach("experiment.yaml", (text or yaml.safe_dump(to_dict(log.experiment))).encode())
    writer.close()
    return Bag(folder)


def test_a_bag_gives_back_the_log(log, tmp_path):
    bag = written(log, tmp_path / "bag")
    again = read_log(bag)
    assert to_dict(again.experiment) == to_dict(log.experiment)
    assert COLUMNS.keys() - again.columns.keys() == {"grf", "contact"}  # in no standard message
    for name in again.columns.keys() - {"prediction"}:
        np.testing.assert_allclose(again.columns[name], log.columns[name], atol=1e-9)
    alone = log.phase >= PHASES.index("closing")  # before, predicted velocities are not recorded
    np.testing.assert_array_equal(again.prediction[alone], log.prediction[alone])
    np.testing.assert_array_equal(again.prediction[:, :4], log.prediction[:, :4])
    assert np.isnan(again.prediction[~alone, 4:]).all()
    assert again.distance == pytest.approx(log.distance)


def test_a_robot_in_a_namespace_is_found_by_it(log, tmp_path):
    bag = written(log, tmp_path / "bag", lambda name: f"/measured{name}")
    for namespace in ("", "measured", "/measured/"):
        np.testing.assert_array_equal(read_log(bag, namespace).q, log.q)
    with pytest.raises(NameUnknownError, match="other/joint_states"):
        read_log(bag, "other")


def test_what_is_not_recorded_is_not_a_number(log, tmp_path):
    extras = ("/imu/data", "/ground_truth/odom", "/joint_prediction")
    bag = written(log, tmp_path / "bag", lambda name: None if name in extras else name)
    again = read_log(bag)
    for name in ("gyro", "position", "orientation", "prediction", "error"):
        assert np.isnan(again.columns[name]).all()
    np.testing.assert_array_equal(again.phase, log.phase)


def test_a_bag_without_commands_is_refused_by_name(log, tmp_path):
    bag = written(log, tmp_path / "bag", lambda n: None if n == "/joint_command" else n)
    with pytest.raises(BagError, match="no messages on joint_command"):
        read_log(bag)
