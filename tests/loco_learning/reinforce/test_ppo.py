# SPDX-License-Identifier: Apache-2.0
"""The adapter to PPO, where stable-baselines3 is installed; it is no part of the set-up."""

import numpy as np
import pytest

pytest.importorskip("stable_baselines3")

from loco_control.exceptions import ParameterError  # noqa: E402
from loco_learning.reflex import weights as weight_files  # noqa: E402
from loco_learning.reinforce.episode import first_weights  # noqa: E402
from loco_learning.reinforce.ppo import learn_by_ppo  # noqa: E402


def test_it_learns_a_readout_within_its_budget_and_the_same_twice(experiment, short, tmp_path):
    start = tmp_path / "zero.npz"
    first_weights(experiment, start, zero=True)
    with pytest.raises(ParameterError, match=r"seconds is 25, but PPO needs 30\.67 s"):
        learn_by_ppo(experiment, short.replace(seconds=25.0), start)
    params, heard = short.replace(seconds=36.0), []
    readout, seconds = learn_by_ppo(experiment, params, start, heard.append)
    assert 36.0 <= seconds < 36.0 + 2.6  # the reset that follows the last tick is counted, too
    assert readout.shape == weight_files.read_readout(start, "joint_weights").shape
    assert np.any(readout[:, :4] != 0.0) and not readout[:, 4:].any()
    assert heard == sorted(heard) and heard
    again, _ = learn_by_ppo(experiment, params, start)
    np.testing.assert_array_equal(readout, again)
