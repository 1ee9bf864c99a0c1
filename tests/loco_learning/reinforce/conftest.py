# SPDX-License-Identifier: Apache-2.0
"""A small reflex of Tigrillo, taught once."""

import pytest

from loco_learning.reinforce.episode import first_weights
from loco_learning.reinforce.params import ReinforceParams
from loco_learning.runs.experiment import load

SMALL = {"learner.neurons": 60, "learner.train": 6.0, "learner.closing": 3.0, "learner.test": 2.0}
SHORT = ReinforceParams(seconds=40.0, lead=1.5, episode=1.5, batch=4, directions=4)


@pytest.fixture(scope="session")
def experiment():
    """Experiment whose readout is taught in nine seconds."""
    return load("tigrillo_bound_reflex", SMALL)


@pytest.fixture(scope="session")
def taught(experiment, tmp_path_factory):
    """Weight file that FORCE wrote; do not change it."""
    path = tmp_path_factory.mktemp("taught") / "start.npz"
    assert first_weights(experiment, path) == 10.0
    return path


@pytest.fixture
def short():
    """Settings of a learning run of a few seconds."""
    return SHORT
