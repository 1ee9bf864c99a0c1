# SPDX-License-Identifier: Apache-2.0
"""Networks that the laws are checked on."""

import numpy as np
import pytest

from loco_sim.msd.network import chain
from loco_sim.msd.params import MsdParams
from loco_sim.msd.simulation import Drive


@pytest.fixture
def gait():
    """Function that draws a drive for a network, or one for several."""

    def draw(network, size=None, amplitude=0.2, seed=1):
        rng = np.random.default_rng(seed)
        shape = (network.count,) if size is None else (size, network.count)
        return Drive(
            rng.uniform(0.0, amplitude, shape),
            rng.uniform(0.0, 2.0 * np.pi, shape),
            rng.uniform(0.5, 2.0, shape[:-1]),
            rng.uniform(50.0, 100.0, shape),
        )

    return draw


@pytest.fixture
def free():
    """Parameters without ground, gravity, drag and damping."""
    return MsdParams(ground="none", gravity=0.0, drag=0.0, damping=0.0)


@pytest.fixture
def pair():
    """Function that makes a chain and its parameters with some changed."""

    def make(**changes):
        params = MsdParams(**changes)
        return chain(params), params

    return make
