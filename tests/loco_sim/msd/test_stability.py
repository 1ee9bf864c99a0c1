# SPDX-License-Identifier: Apache-2.0
"""The largest step: just below it nothing grows, well above it everything does."""

import numpy as np
import pytest

from loco_sim.msd.network import Network, chain
from loco_sim.msd.params import MsdParams
from loco_sim.msd.simulation import MsdSimulation
from loco_sim.msd.stability import largest_step


def test_an_oscillator_is_stable_up_to_two_over_omega():
    network = Network([[0.0, 0.0], [1.0, 0.0]], [(0, 1)], [1e9, 1.0], 100.0, 0.0)
    assert largest_step(network, MsdParams(drag=0.0)) == pytest.approx(0.2, rel=0.02)


@pytest.mark.parametrize("integrator", ["verlet", "author"])
@pytest.mark.parametrize(("stiffness", "damping"), [(1000.0, 0.0), (100.0, 40.0), (1.0, 40.0)])
def test_just_below_the_limit_a_line_of_nodes_stays_calm(integrator, stiffness, damping):
    line = np.stack([np.arange(12.0), np.zeros(12)], axis=1)
    links = [(i, i + 1) for i in range(11)]
    network = Network(line, links, 1.0, stiffness, damping)
    params = MsdParams(
        ground="none", gravity=0.0, drag=0.0, nonlinearity=0.0, integrator=integrator
    )
    limit = largest_step(network, params)
    start = line + [[1e-4 * (-1) ** i, 0.0] for i in range(12)]
    reach = []
    for factor in (0.97, 1.1):
        p = params.replace(step=limit * factor)
        simulation = MsdSimulation(network, params.replace(step=limit * 0.5))
        simulation.params = p
        simulation._make_constants()
        simulation.place(start, 0.0 * start)
        simulation.run(4000)
        reach.append(np.abs(simulation.position - line).max())
    assert reach[0] < 1e-2
    assert not reach[1] < 1e-1


def test_the_chain_of_the_thesis_runs_at_its_step():
    params = MsdParams(nodes=26, total_mass=20.0, stiffness=1000.0)
    assert largest_step(chain(params), params) > params.step
