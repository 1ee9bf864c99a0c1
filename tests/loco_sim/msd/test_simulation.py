# SPDX-License-Identifier: Apache-2.0
"""Laws of motion of the networks; the first test to run compiles the kernels, 5 s."""

import tracemalloc

import numpy as np
import pytest

from loco_control.exceptions import DivergedError, ParameterError
from loco_sim.msd.network import Network, chain
from loco_sim.msd.params import PRESETS, MsdParams, NoiseParams
from loco_sim.msd.simulation import Drive, MsdSimulation


def kinetic_energy(network: Network, velocity: np.ndarray) -> np.ndarray:
    """Sum of m v² / 2 [J] of velocities (…, nodes, axes) [m/s]."""
    return 0.5 * np.sum(network.masses[:, None] * velocity**2, axis=(-2, -1))


def potential_energy(
    network: Network, params: MsdParams, position: np.ndarray, factor: np.ndarray | float = 1.0
) -> np.ndarray:
    """Potential energy of gravity and springs [J] at positions (…, nodes, axes) [m].

    A spring of eq. (4.3) holds k (e²/2 + beta e⁴ / (4 l_ref²)), e its stretch.

    Args:
        network: Nodes and links.
        params: Gravity and nonlinearity.
        position: Positions of the nodes [m].
        factor: Driven length / rest length of the links, (…, links).
    """
    height = position[..., -1] @ network.masses
    i, j = network.links.T
    length = np.linalg.norm(position[..., j, :] - position[..., i, :], axis=-1)
    stretch = length - network.rest * factor
    hardening = params.nonlinearity * stretch**4 / (4.0 * network.rest**2)
    return params.gravity * height + np.sum(
        network.stiffness * (0.5 * stretch**2 + hardening), axis=-1
    )


def momentum(network: Network, velocity: np.ndarray) -> np.ndarray:
    """Sum of m v [N·s], (…, axes)."""
    return np.sum(network.masses[:, None] * velocity, axis=-2)


def energies(network, params, history):
    return kinetic_energy(network, history.velocity) + potential_energy(
        network, params, history.position
    )


def stretched(simulation, by=1.1):
    """Let a network go from `by` times its size."""
    simulation.place(by * simulation.network.positions, 0.0 * simulation.network.positions)
    return simulation


@pytest.mark.parametrize("nonlinearity", [0.0, 0.5])
@pytest.mark.parametrize("dimension", [2, 3])
def test_energy_of_a_free_network_does_not_drift(free, nonlinearity, dimension):
    params = free.replace(nonlinearity=nonlinearity, dimension=dimension, gravity=9.81)
    network = chain(params)
    history = stretched(MsdSimulation(network, params)).run(40000, every=40)
    e = energies(network, params, history)
    moving = np.max(kinetic_energy(network, history.velocity - history.velocity.mean(1)[:, None]))
    assert moving > 1.0
    assert np.ptp(e) < 0.02 * np.ptp(potential_energy(network, params, history.position))
    np.testing.assert_allclose(e[:100].mean(), e[-100:].mean(), rtol=1e-3, atol=1e-2 * moving)


@pytest.mark.parametrize("damper", ["along_link", "full_vector"])
@pytest.mark.parametrize("ground", ["stick", "none"])
def test_energy_never_grows_with_damping_and_no_actuation(pair, damper, ground):
    network, params = pair(damper=damper, ground=ground, step=0.001)
    simulation = stretched(MsdSimulation(network, params), 1.2)
    first = potential_energy(network, params, simulation.position)
    e = np.append(first, energies(network, params, simulation.run(4000, every=1)))
    assert np.max(np.diff(e)) < 1e-4 * abs(first)
    assert e.max() <= first + 1e-4 * abs(first)
    assert e[-1] < first


@pytest.mark.parametrize("damper", ["along_link", "full_vector"])
def test_momentum_is_kept_without_gravity_and_ground(free, gait, damper):
    params = free.replace(damper=damper, damping=3.0)
    network = chain(params)
    simulation = MsdSimulation(network, params, gait(network))
    velocity = np.random.default_rng(0).normal(size=network.positions.shape)
    simulation.place(network.positions, velocity)
    history = simulation.run(2000, every=200)
    assert np.abs(history.velocity).max() > 1.0
    expected = np.tile(momentum(network, velocity), (10, 1))
    np.testing.assert_allclose(momentum(network, history.velocity), expected, atol=1e-10)


@pytest.mark.parametrize(("mass", "stiffness"), [(1.0, 100.0), (20.0 / 26.0, 50.0), (4.0, 64.0)])
def test_a_single_node_swings_at_its_resonance(free, mass, stiffness):
    wall = 1e9
    network = Network([[0.0, 0.0], [1.0, 0.0]], [(0, 1)], [wall, mass], stiffness, 0.0)
    simulation = MsdSimulation(network, free.replace(nonlinearity=0.0))
    simulation.place([[0.0, 0.0], [1.2, 0.0]], np.zeros((2, 2)))
    x = simulation.run(8000, every=1).position[:, 1, 0] - 1.0
    upward = np.flatnonzero((x[:-1] < 0.0) & (x[1:] >= 0.0))
    crossings = upward + x[upward] / (x[upward] - x[upward + 1])
    frequency = (len(upward) - 1) / (np.ptp(crossings) * free.step)
    assert frequency == pytest.approx(np.sqrt(stiffness / mass) / (2.0 * np.pi), rel=1e-3)


@pytest.mark.parametrize("damping", [0.0, 10.0])
@pytest.mark.parametrize(("integrator", "order"), [("verlet", 2), ("author", 1)])
def test_order_of_convergence(gait, damping, integrator, order):
    if integrator == "author" and damping == 0.0:
        order = 1  # its first instant has no acceleration
    ends = []
    for halving in range(4):
        params = MsdParams(
            nodes=6, ground="none", damping=damping, integrator=integrator, step=0.004 / 2**halving
        )
        network = chain(params)
        simulation = MsdSimulation(network, params, gait(network))
        simulation.run(250 * 2**halving)
        ends.append(simulation.position)
    errors = [np.linalg.norm(end - ends[-1]) for end in ends[:-1]]
    ratio = (errors[0] - errors[1]) / (errors[1] - errors[2])
    assert np.log2(ratio) == pytest.approx(order, abs=0.25)


@pytest.mark.parametrize("name", PRESETS)
def test_a_mirrored_network_moves_in_the_mirror(gait, name):
    params = PRESETS[name].params
    network = chain(params)
    mirror = np.array([-1.0, 1.0])
    twin = Network(
        network.positions * mirror, network.links, network.masses, 100.0, network.damping
    )
    drive = gait(network)
    one, two = MsdSimulation(network, params, drive), MsdSimulation(twin, params, drive)
    one.run(2000)
    two.run(2000)
    np.testing.assert_array_equal(one.position, two.position * mirror)
    assert abs(network.centre_of_mass(one.position)[0]) > 1e-3


@pytest.mark.parametrize("name", PRESETS)
def test_two_dimensions_in_three_are_the_same(gait, name):
    params = PRESETS[name].params
    network = chain(params)
    drive = gait(network)
    deeper = Network(
        np.insert(network.positions, 1, 0.0, axis=1), network.links, network.masses,
        network.stiffness, network.damping, network.rest,
    )  # fmt: skip
    flat, deep = MsdSimulation(network, params, drive), MsdSimulation(deeper, params, drive)
    flat.run(2000)
    deep.run(2000)
    np.testing.assert_array_equal(deep.position[:, [0, 2]], flat.position)
    assert not deep.position[:, 1].any()


@pytest.mark.parametrize("name", PRESETS)
@pytest.mark.parametrize("dimension", [2, 3])
@pytest.mark.parametrize("size", [1, 8, 11])
def test_a_network_has_the_same_bits_alone_and_in_a_population(gait, name, dimension, size):
    preset = PRESETS[name]
    params = preset.params.replace(dimension=dimension)
    network, noise = chain(params), preset.noise.replace(actuation=0.04)
    d = gait(network, size)
    together = MsdSimulation(network, params, d, noise, seed=5)
    histories = together.run(1200, every=100)
    for q in {0, size // 2, size - 1}:
        drive = Drive(d.amplitude[q], d.phase[q], d.frequency[q], d.stiffness[q])
        alone = MsdSimulation(network, params, drive, noise, seed=5 + q)
        history = alone.run(1200, every=100)
        for one, many in zip(history[1:], histories[1:], strict=True):
            np.testing.assert_array_equal(one, many[q])
        np.testing.assert_array_equal(alone.acceleration, together.acceleration[q])


def test_a_custom_graph_runs_alone_and_in_a_population():
    rng = np.random.default_rng(3)
    tree = [(int(rng.integers(i)), i) for i in range(1, 23)]
    more = {tuple(sorted(map(int, rng.choice(23, 2, replace=False)))) for _ in range(30)}
    network = Network(rng.uniform(0.0, 3.0, (23, 3)), sorted(set(tree) | more), 1.0, 60.0, 2.0)
    params = MsdParams(step=0.002)
    amplitude, phase = rng.uniform(0.0, 0.2, (2, 3, network.count))
    together = MsdSimulation(network, params, Drive(amplitude, phase, 1.3))
    together.run(500)
    alone = MsdSimulation(network, params, Drive(amplitude[2], phase[2], 1.3))
    alone.run(500)
    np.testing.assert_array_equal(alone.position, together.position[2])
    assert alone.position[:, 2].min() >= 0.0


def test_a_run_in_pieces_is_the_same_run(gait):
    network = chain()
    one, two = (MsdSimulation(network, drive=gait(network), seed=2) for _ in range(2))
    one.run(1000)
    for steps in (1, 510, 3, 486):
        two.run(steps)
    np.testing.assert_array_equal(one.position, two.position)
    assert two.time == pytest.approx(5.0)


def test_reset_repeats_a_noisy_run_and_another_seed_does_not(gait):
    network, noise = chain(), PRESETS["author_code"].noise
    simulation = MsdSimulation(network, None, gait(network), noise, seed=1)
    simulation.run(300)
    first = simulation.position
    simulation.reset()
    simulation.run(300)
    np.testing.assert_array_equal(simulation.position, first)
    other = MsdSimulation(network, None, gait(network), noise, seed=2)
    other.run(300)
    assert np.abs(other.position - first).max() > 1e-6


def test_given_factors_of_the_sine_are_the_drive(gait):
    network = chain()
    drive = gait(network)
    one, two = MsdSimulation(network, drive=drive), MsdSimulation(network, drive=drive)
    one.run(400)
    for k in range(1, 201):
        angle = 2.0 * np.pi * drive.frequency * k * 0.005 + drive.phase
        two.step(1.0 + drive.amplitude * np.sin(angle))
    two.run(200)
    np.testing.assert_allclose(two.position, one.position, atol=1e-9)


def test_nodes_stick_to_the_ground_until_they_are_lifted(pair):
    network, params = pair(nodes=6)
    simulation = MsdSimulation(network, params)
    history = simulation.run(2000, every=1)
    down = (history.position[1:, :, 1] == 0.0) & (history.position[:-1, :, 1] == 0.0)
    moved = np.abs(np.diff(history.position[:, :, 0], axis=0))
    assert down.sum() > 1000
    assert moved[down].max() == 0.0


def test_nodes_creep_on_the_ground_of_the_authors_code(pair):
    network, params = pair(nodes=6, ground="author", integrator="author")
    history = MsdSimulation(network, params).run(200, every=1)
    down = (history.position[1:, :, 1] == 0.0) & (history.position[:-1, :, 1] == 0.0)
    assert np.abs(np.diff(history.position[:, :, 0], axis=0))[down].max() > 1e-5


def test_impulses_push_one_node_as_often_as_said(free):
    network = chain(free)
    noise = NoiseParams(impulse_rate=0.05, impulse_size=0.5)
    simulation = stretched(MsdSimulation(network, free, noise=noise, seed=9))
    twin = stretched(MsdSimulation(network, free))
    pushed = []
    for _ in range(2000):
        twin.place(simulation.position, simulation.velocity)
        twin._state[...] = simulation._state
        simulation.run(1)
        twin.run(1)
        pushed.append(np.any(simulation.acceleration != twin.acceleration, axis=1).sum())
    assert set(pushed) == {0, 1}
    assert 0.03 < np.mean(pushed) < 0.07


def test_a_step_that_is_too_large_is_refused_with_its_limit():
    network = chain(MsdParams(stiffness=1e6))
    with pytest.raises(
        ParameterError, match=r"step 0.005 s is too large .* stable up to 0\.000\d+ s"
    ):
        MsdSimulation(network)
    drive = Drive(
        np.zeros(network.count), np.zeros(network.count), 1.0, np.full(network.count, 100.0)
    )
    MsdSimulation(network, drive=drive)


@pytest.mark.parametrize(
    ("drive", "text"),
    [
        (Drive(np.zeros(54), np.zeros(53)), r"phase must have shape \(54,\), got \(53,\)"),
        (Drive(np.zeros(54), np.zeros(54), np.nan), "frequency must be finite"),
        (Drive(np.zeros(54), np.zeros(54), 1.0, np.full(54, -1.0)), "stiffness must be 0 or more"),
    ],
)
def test_a_drive_that_does_not_fit_is_refused(drive, text):
    with pytest.raises(ParameterError, match=text):
        MsdSimulation(chain(), drive=drive)


def test_divergence_is_said(free):
    network = chain(free)
    simulation = MsdSimulation(network, free)
    simulation.place(network.positions * 1e160, network.positions)
    simulation.run(100)
    with pytest.raises(DivergedError, match="before 0.5 s"):
        simulation.check_finite()


def test_a_long_run_takes_no_memory(gait):
    simulation = MsdSimulation(chain(), drive=gait(chain()))
    simulation.run(10)
    tracemalloc.start()
    simulation.run(120_000)  # ten minutes
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < 20_000


def test_history_wants_a_stride_that_fits():
    with pytest.raises(ParameterError, match="multiple of every, got 10 and 3"):
        MsdSimulation(chain()).run(10, every=3)
