# SPDX-License-Identifier: Apache-2.0
"""Kernels and textbook say the same to 1e-9 m, with and without ground, in two and three axes."""

import numpy as np
import pytest

from loco_sim.msd.network import chain
from loco_sim.msd.params import PRESETS
from loco_sim.msd.simulation import MsdSimulation
from loco_workshop.textbook import TextbookSimulation


@pytest.mark.parametrize("name", PRESETS)
@pytest.mark.parametrize("change", [{}, {"ground": "none"}, {"dimension": 3}, {"nodes": 4}])
def test_trajectories_agree(gait, name, change):
    params = PRESETS[name].params.replace(**change)
    network = chain(params)
    drive = gait(network)
    ours, textbook = (
        kind(network, params, drive=drive) for kind in (MsdSimulation, TextbookSimulation)
    )
    for _ in range(10):
        ours.run(100)
        textbook.run(100)
        np.testing.assert_allclose(ours.position, textbook.position, rtol=0.0, atol=1e-9)
    assert np.ptp(ours.velocity) > 0.1
