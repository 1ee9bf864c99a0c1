# SPDX-License-Identifier: Apache-2.0
"""Structure of networks, and what is refused."""

import numpy as np
import pytest

from loco_control.exceptions import NameUnknownError, ParameterError
from loco_sim.msd.network import Network, chain
from loco_sim.msd.params import PRESETS, MsdParams, preset

TRIANGLE = np.array([[0.0, 0.0], [1.0, 0.0], [0.5, 1.0]])
SIDES = [(0, 1), (1, 2), (2, 0)]


@pytest.mark.parametrize("nodes", [4, 5, 6, 20, 26, 200])
@pytest.mark.parametrize("connections", [2, 4, 6])
def test_chain_has_the_links_of_equation_4_1(nodes, connections):
    network = chain(MsdParams(nodes=nodes, connections=connections))
    half = connections / 2
    assert network.count == (nodes - 1 - (half - 1) / 2) * half


def test_twenty_nodes_have_54_links_and_three_have_all_three():
    assert chain().count == 54
    assert chain(MsdParams(nodes=3)).count == 3
    assert chain(MsdParams(nodes=2)).count == 1


def test_even_nodes_lie_on_an_arch_and_odd_ones_on_the_ground():
    x, z = chain(MsdParams(nodes=20, height=4.0)).positions.T
    np.testing.assert_allclose(np.diff(x), 1.0)
    assert abs(x.mean()) < 1e-12
    assert (z[1::2] == 0.0).all()
    np.testing.assert_allclose(z[::2], 4.0 * (1.0 - (2.0 * x[::2] / 20.0) ** 2))


def test_three_dimensions_spread_the_nodes_sideways():
    network = chain(MsdParams(dimension=3, width=0.3))
    assert network.dimension == 3
    np.testing.assert_allclose(np.unique(network.positions[:, 1]), [-0.3, 0.0, 0.3])


def test_total_mass_is_shared():
    assert chain(MsdParams(nodes=8, total_mass=20.0)).masses.sum() == pytest.approx(20.0)


def test_links_are_sorted_with_what_belongs_to_them():
    network = Network(TRIANGLE, SIDES, 1.0, [1.0, 2.0, 3.0], [4.0, 5.0, 6.0])
    np.testing.assert_array_equal(network.links, [(0, 1), (0, 2), (1, 2)])
    np.testing.assert_array_equal(network.stiffness, [1.0, 3.0, 2.0])
    np.testing.assert_array_equal(network.damping, [4.0, 6.0, 5.0])
    np.testing.assert_allclose(network.rest, np.sqrt([1.0, 1.25, 1.25]))


@pytest.mark.parametrize(
    ("change", "text"),
    [
        ({"positions": TRIANGLE[:, :1]}, r"positions must be \(nodes, 2\)"),
        ({"positions": TRIANGLE * np.nan}, "positions must be finite"),
        ({"links": [(0, 1)]}, "not connected: no links lead from node 0 to node 2; it has 2 parts"),
        ({"links": [(0, 1), (1, 1)]}, "joins node 1 to itself"),
        ({"links": [(0, 1), (1, 0), (1, 2)]}, "nodes 0 and 1 are linked twice"),
        ({"links": [(0, 1), (1, 3)]}, "joins nodes 1 and 3; there are 0 to 2"),
        ({"links": [0, 1]}, "links must be pairs"),
        ({"positions": TRIANGLE * 0.0}, "has no length"),
        ({"masses": [1.0, -1.0, 1.0]}, r"mass of node 1 must be positive \[kg\], got -1"),
        ({"masses": 0.0}, "mass of node 0 must be positive"),
        ({"masses": [1.0, 2.0]}, "masses must have 3 values"),
        ({"stiffness": -5.0}, r"stiffness of link 0 \(nodes 0 and 1\) must be 0 or more"),
        ({"damping": [0.0, -1.0, 0.0]}, r"damping of link 2 \(nodes 1 and 2\) .* got -1"),
        ({"rest": [1.0, 0.0, 1.0]}, "rest length of link 2 .* must be positive"),
    ],
)
def test_mistakes_are_refused_in_one_line(change, text):
    with pytest.raises(ParameterError, match=text) as caught:
        Network(**{"positions": TRIANGLE, "links": SIDES, **change})
    assert "\n" not in str(caught.value)


def test_presets_differ_in_what_the_code_did_otherwise():
    thesis, code = PRESETS["thesis"].params, PRESETS["author_code"].params
    assert (thesis.damping, code.damping) == (10.0, 1.0)
    assert (thesis.damper, code.damper) == ("along_link", "full_vector")
    assert (thesis.stiffness, thesis.nodes, thesis.connections) == (100.0, 20, 6)
    assert preset("thesis").params == MsdParams()
    with pytest.raises(NameUnknownError, match="author_code, thesis"):
        preset("authors_code")
