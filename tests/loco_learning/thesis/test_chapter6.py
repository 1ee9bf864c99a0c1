# SPDX-License-Identifier: Apache-2.0
"""What measures of chapter 6 say of searches and closed loops whose answer is known."""

from types import SimpleNamespace

import numpy as np
import pytest

from loco_learning.networks import results
from loco_learning.networks.jobs import Curves
from loco_learning.networks.results import Results
from loco_learning.thesis.registry import MEASURES, NotRunError

from .made import Other

SIZES = (3, 5, 6, 10, 20)


def search(best=1.0, clean=None, speed=1.0, reached=10, rising=False, watts=1.0):
    """A search whose mean score reaches `best` at a generation, or rises to its end."""
    mean = np.where(np.arange(80) < reached, 0.1, best)
    if rising:
        mean = np.linspace(0.0, best, 80)
    clean = best if clean is None else clean
    return SimpleNamespace(best=best, clean=clean, speed=speed, population=10, watts=watts,
                           course=np.stack([mean, mean, mean], axis=1))  # fmt: skip


def gaits(make, seeds=2):
    return {(n, seed): make(n, seed) for n in SIZES for seed in range(seeds)}


def test_scores_are_compared_within_a_repetition():
    """The second falls with size; a sixth search of 20 nodes belongs to no whole repetition."""
    table = gaits(lambda n, seed: search(n if seed == 0 else 30.0 - n)) | {(20, 5): search(99.0)}
    found = MEASURES["score_grows"](Other(Results(gaits=table)))
    assert found["rho"] == pytest.approx([1.0, -1.0])
    assert found["five_over_three"] == pytest.approx([5 / 3, 25 / 27])
    assert found["largest_score"].tolist() == [20.0, 10.0]


def test_a_gap_is_that_of_small_networks_and_its_trend():
    table = gaits(lambda n, seed: search(1.0, clean=1.0 - 1.0 / n))
    found = MEASURES["gap_shrinks"](Other(Results(gaits=table)))
    assert found["rho"] == pytest.approx([-1.0, -1.0])
    assert found["small_gap"] == pytest.approx([(1 / 3 + 1 / 5) / 2] * 2)


def test_a_search_takes_longer_and_the_smallest_does_not_converge():
    def make(n, seed):
        made = search(reached=n)
        if n == 3:
            made.course[-20:, 1] = 0.2
        return made

    found = MEASURES["convergence"](Other(Results(gaits=gaits(make))))
    assert found["three_mean_over_best"] == pytest.approx([0.2, 0.2])
    assert found["rho"].min() > 0.9 and found["still_rising"] == 0.0
    rising = gaits(lambda n, seed: search(rising=True))
    assert MEASURES["convergence"](Other(Results(gaits=rising)))["still_rising"] == 1.0


def test_speeds_and_powers_are_those_of_the_sizes(monkeypatch):
    monkeypatch.setattr(results, "author_power", lambda g: g.watts)
    table = gaits(lambda n, seed: search(speed=n / 3.6, watts=float(n)))
    found = MEASURES["speeds"](Other(Results(gaits=table)))
    assert found["kmh_of_6"] == pytest.approx([6.0, 6.0])
    assert found["kmh_of_20"] == pytest.approx([20.0, 20.0])
    assert found["power_ratio"] == pytest.approx([20 / 6, 20 / 6])  # from 6 nodes on


def test_a_node_on_a_spring_swings_at_the_frequency_of_the_book():
    found = MEASURES["resonance"](Other(Results()))
    book = [np.sqrt(ratio) / (2.0 * np.pi) for ratio in (14.2, 100.0, 127.9)]
    assert list(found.values()) == pytest.approx(book, rel=1e-3)


RATES = (0.25, 0.5, 1.0, 2.0, 4.5, 9.0)


def test_a_band_ends_at_half_of_the_power():
    """A score of 1 from 0.5 to 4.5 Hz, and 0 outside of it."""
    omega = {(n, k, 0): search(clean=float(0.5 <= f <= 4.5))
             for n in (5, 20) for k, f in enumerate(RATES)}  # fmt: skip
    found = MEASURES["bandwidth"](Other(Results(omega=omega, frequencies=RATES)))
    assert 0.4 < found["low"][0] < 0.5 and 4.5 < found["high"][0] < 5.6


def test_larger_networks_are_better_at_high_frequencies_or_not():
    omega = {(n, k, seed): search(clean=n if seed == 0 else 30.0 - n)
             for n in (5, 10, 20) for k in range(len(RATES)) for seed in range(2)}  # fmt: skip
    found = MEASURES["high_frequencies"](Other(Results(omega=omega, frequencies=RATES)))
    assert found["fast_gain"].tolist() == [15.0, -15.0]
    assert found["least_best_ratio"] == pytest.approx([0.5, 2.5])


def test_the_best_rate_and_its_line_up_to_15_kW():
    powers = {(p, f, 0): search(speed=p / 1e3 * (2.0 if f == 3.0 else 1.0) if p < 2e4 else 14.0)
              for p in (500.0, 5e3, 1.5e4, 2e4) for f in (1.0, 3.0)}  # fmt: skip
    found = MEASURES["power_budget"](Other(Results(powers=powers)))
    assert (found["best_rate"], found["speed_at_most_power"]) == (3.0, 14.0)
    assert found["r2_to_15_kW"] == pytest.approx(1.0)


def test_strong_gaits_are_told_beside_weak_ones(monkeypatch):
    monkeypatch.setattr(results, "gait_shape", lambda g: (g.speed, g.clean))
    powers = {(p, f, 0): search(speed=p, clean=1.0 / p) for p in (1.0, 2.0) for f in (1.0, 3.0)}
    found = MEASURES["periodicity"](Other(Results(powers=powers)))
    assert (found["stretch_ratio"], found["likeness_change"]) == (2.0, -0.5)


def test_a_knee_is_that_of_each_gait():
    noise = np.logspace(-4.0, 0.0, 41)
    sweeps = {
        gait: Curves({}, {"noise": noise, "distance": np.where(noise < at, 10.0, 1.0)[:, None]})
        for gait, at in enumerate((0.01, 0.3))
    }
    found = MEASURES["noise_knee"](Other(Results(noise=sweeps)))
    assert found["knee"] == pytest.approx([0.01, 0.3], rel=0.6)


def loop(share=1.0, nrmse=0.1, error=0.1, rough=0.0):
    """A closed loop that goes a share of the open loop's 10 m."""
    t = np.arange(0.0, 13.0, 0.05)
    cycle = np.stack([np.cos(2.0 * np.pi * t), np.sin(2.0 * np.pi * t)], axis=1)
    cycle = cycle + rough * np.random.default_rng(0).normal(size=cycle.shape)
    values = {"closed": 10.0 * share, "open": 10.0, "nrmse": nrmse, "period": 1.0}
    return Curves(values, {"t": t, "error": np.where(t < 5.0, 1.0, error), "cycle": cycle})


def test_an_error_is_that_of_the_first_and_of_the_twelfth_second():
    loops = {(20, 0): loop(error=0.1), (20, 1): loop(error=0.001), (5, 0): loop(error=9.0)}
    found = MEASURES["training"](Other(Results(loops=loops)))
    assert found["first_second"].tolist() == [1.0, 1.0]
    assert found["twelfth_second"] == pytest.approx([0.1, 0.001])


def test_a_regularisation_is_compared_gait_by_gait_with_the_best_other_one():
    """Medians over the noises of a gait; 1 is best over the gaits, though not for the second."""
    shares = {0.01: ([0.5, 0.5, 9.0], [0.8] * 3), 1.0: ([0.9] * 3, [0.7] * 3),
              100.0: ([0.1] * 3, [0.9] * 3)}  # fmt: skip
    alphas = {(alpha, gait, draw): loop(value)
              for alpha, rows in shares.items() for gait, row in enumerate(rows)
              for draw, value in enumerate(row)}  # fmt: skip
    found = MEASURES["regularisation"](Other(Results(alphas=alphas)))
    assert found["best_other"] == 1.0
    assert found["minus_best"] == pytest.approx([-0.4, 0.1])
    assert found["share_at_100"] == pytest.approx([0.1, 0.9])


def test_closed_loops_are_counted_and_ranked_by_size():
    def make(n, seed):
        return loop(0.4 if n == 10 else 0.6, nrmse=1.0 / n if seed == 0 else n, rough=1.0 / n)

    evidence = Other(Results(loops=gaits(make)))
    assert MEASURES["closed_loops"](evidence)["stable_sizes"] == pytest.approx([2 / 3, 2 / 3])
    assert MEASURES["limit_cycles"](evidence)["rho"].max() < -0.9
    assert MEASURES["readout_error"](evidence)["rho"] == pytest.approx([-1.0, 1.0])


def test_the_parameters_are_counted_in_a_gait():
    gait = SimpleNamespace(gait=SimpleNamespace(amplitude=np.zeros(54)))
    found = MEASURES["parameters"](Other(Results(gaits={(20, 0): gait})))
    assert found == {"parameters": 163.0}


def test_a_measure_without_results_says_what_is_missing():
    for name, what in (("score_grows", "gaits"), ("bandwidth", "fixed frequencies"),
                       ("power_budget", "limited power"), ("noise_knee", "noise"),
                       ("training", "closed loop"), ("regularisation", "other regularisations"),
                       ("closed_loops", "closed loops"), ("parameters", "20 nodes")):  # fmt: skip
        with pytest.raises(NotRunError, match=what):
            MEASURES[name](Other(Results()))
