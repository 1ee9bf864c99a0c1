# SPDX-License-Identifier: Apache-2.0
"""A network of masses and springs as a graph: the numbers of the loop without ROS, and a page."""

import numpy as np
import pytest
import yaml

from loco_bringup.bag.reader import Bag
from loco_bringup.graph import run as runner
from loco_bringup.logs.rollout_bag import run_rollout
from loco_bringup.report import network as msd_report
from loco_bringup.report.report import write_report
from loco_control.exceptions import BagError, ParameterError
from loco_learning.networks.reservoir import run_loop
from loco_learning.runs.experiment import from_values, load

pytestmark = [pytest.mark.ros, pytest.mark.xdist_group("graph")]

SHORT = {"loop.train": 0.8, "loop.closing": 0.2, "loop.test": 0.6}


@pytest.fixture(scope="module")
def experiment():
    return load("msd_20", SHORT)


@pytest.fixture(scope="module", params=["composed", "processes"])
def bag(request, experiment, tmp_path_factory):
    folder = tmp_path_factory.mktemp("msd") / request.param
    outcome = runner.run(experiment, folder, request.param)
    assert outcome.exit_code == 0
    assert outcome.dropped == 0
    assert "m forward" in outcome.text
    return Bag(folder)


def test_the_graph_is_the_loop_bit_by_bit(bag, experiment):
    log = msd_report.read_msd_log(bag)
    loop = run_loop(experiment.network, experiment.make_gait(), experiment.loop, every=1)
    assert len(log.t) == experiment.ticks
    np.testing.assert_array_equal(log.prediction, loop.said)
    np.testing.assert_array_equal(log.target, loop.target)
    np.testing.assert_allclose(log.distance[1:], loop.distance[:-1], atol=1e-12)


def test_phases_are_told_and_the_test_is_driven_by_the_readout_alone(bag):
    events = bag.messages("events")
    assert [e.text for e in events if e.kind == "phase"] == ["train", "closing", "test"]
    log = msd_report.read_msd_log(bag)
    test = log.t >= 1.0
    reach = np.clip(log.prediction[test], 0.0, 2.0)
    np.testing.assert_array_equal(log.command[test], reach)
    np.testing.assert_array_equal(log.command[log.t < 0.79], log.target[log.t < 0.79])


def test_the_report_shows_figures_and_an_animation(bag, tmp_path):
    page = write_report(bag, tmp_path / "report.html")
    text = page.read_text()
    for title in ("Distance", "Learning", "Links", "Limit cycle", "Messages"):
        assert f"<h2>{title}</h2>" in text
    assert "image/gif" in text.partition("<h2>")[0]  # on the first screen
    assert "20 masses and 54 springs went" in text
    assert (tmp_path / "gait.gif").read_bytes()[:3] == b"GIF"
    short = write_report(bag, tmp_path / "still.html", gif=False).read_text()
    assert "left out on request" in short


def test_a_bag_without_states_says_so(bag):
    class Empty:
        path = bag.path

        def yaml(self, name):
            return bag.yaml(name)

        def raw(self, topic):
            return [], []

    with pytest.raises(BagError, match="no messages on node_states"):
        msd_report.read_msd_log(Empty())


def test_what_a_network_cannot_do_is_said(experiment, tmp_path):
    with pytest.raises(ParameterError, match="msd_20 runs as nodes"):
        run_rollout(experiment, tmp_path, lambda progress: None)
    values = yaml.safe_load("{preset: thesis, gait: {amplitude: [0.1]}}")
    with pytest.raises(ParameterError, match="gait.amplitude must have 54 values, one per link"):
        from_values(values)
    with pytest.raises(ParameterError, match="one tick per step, 200 Hz, got 100"):
        from_values({"kind": "msd", "control_rate": 100.0})
