# SPDX-License-Identifier: Apache-2.0
"""One short run per layout, shared by all tests of this folder."""

import pytest

from loco_bringup.graph import run as runner
from loco_bringup.logs.rollout_bag import run_rollout
from loco_learning.runs.experiment import load

SHORT = {"learner.train": 1.5, "learner.closing": 0.5, "learner.test": 0.5}


@pytest.fixture(scope="session")
def short():
    return load("hyq_short", SHORT)


@pytest.fixture(scope="session")
def outcomes(short, tmp_path_factory):
    """Runs by name: rollout, composed and in processes."""
    root = tmp_path_factory.mktemp("bags")
    made = {"rollout": run_rollout(short, root / "rollout", lambda progress: None)}
    for layout in runner.LAYOUTS:
        made[layout] = runner.run(short, root / layout, layout)
    return made
