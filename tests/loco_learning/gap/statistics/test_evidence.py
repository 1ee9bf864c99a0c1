# SPDX-License-Identifier: Apache-2.0
"""Odds mean something: near 1 between equals, large for the truth, rarely for chance."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter1d

from loco_learning.gap.statistics import evidence

TICKS, CHANNELS, TRIALS = 1500, 2, 100


def slow(rng, ticks: int = TICKS, width: float = 15.0) -> np.ndarray:
    """Systematic error of unit rms, correlated over `width` samples."""
    x = gaussian_filter1d(rng.normal(size=(ticks, CHANNELS)), width, axis=0, mode="wrap")
    return x / x.std(0)


def pair(seed: int, a: float, b: float, width: float = 15.0) -> evidence.Comparison:
    """Two models with systematic errors of sizes `a` and `b` [floors] on the same noise."""
    rng = np.random.default_rng(seed)
    white = rng.normal(size=(TICKS, CHANNELS))
    models = [evidence.score([white + size * slow(rng, width=width)]) for size in (a, b)]
    return evidence.compare(*models, rng)


def pairs(a: float, b: float, width: float = 15.0) -> list[evidence.Comparison]:
    return [pair(seed, a, b, width) for seed in range(TRIALS)]


@pytest.mark.parametrize("size", [0.1, 1.0, 30.0])
@pytest.mark.parametrize("width", [4.0, 50.0])
def test_equals_get_odds_near_1(size, width):
    found = pairs(size, size, width)
    odds = np.array([c.odds for c in found])
    assert 0.3 < np.median(odds) < 3.0
    assert np.mean(odds > 10.0) <= 0.1
    assert np.mean(odds < 0.1) <= 0.1
    assert np.mean([c.low > 0.0 for c in found]) <= 0.05
    assert 0.3 < np.mean([c.blocks_improved for c in found]) < 0.7


@pytest.mark.parametrize(("right", "wrong"), [(0.0, 0.2), (0.0, 3.0), (0.1, 0.5), (2.0, 4.0)])
def test_the_better_gets_large_odds(right, wrong):
    found = pairs(right, wrong)
    assert np.mean([c.odds > 10.0 for c in found]) >= 0.95
    assert np.mean([c.low > 0.0 for c in found]) >= 0.9
    assert np.mean([c.blocks_improved for c in found]) > 0.75


def test_a_parameter_fitted_to_noise_gains_nothing():
    """One sine too many, fitted on one record, does not pass on the next."""
    passed = 0
    for seed in range(TRIALS):
        rng = np.random.default_rng(seed)
        extra = slow(rng)
        fit, held = rng.normal(size=(2, TICKS, CHANNELS))
        size = (fit * extra).sum() / (extra**2).sum()
        with_it, without = (evidence.score([held - s * extra]) for s in (size, 0.0))
        passed += evidence.compare(with_it, without, rng).low > 0.0
    assert passed / TRIALS <= 0.05


def test_exchange_turns_the_evidence_round():
    rng = np.random.default_rng(3)
    a, b = (evidence.score([rng.normal(size=(400, 2)) + s * slow(rng, 400)]) for s in (0.2, 1.0))
    ab, ba = (evidence.compare(*x, np.random.default_rng(0)) for x in ((a, b), (b, a)))
    assert ab.gain == pytest.approx(-ba.gain)
    assert ab.odds == pytest.approx(1.0 / ba.odds, rel=0.05)
    assert ab.low == pytest.approx(-ba.high, rel=0.2)


def test_the_same_model_twice_is_no_evidence():
    a = evidence.score([np.random.default_rng(0).normal(size=(300, 3))])
    same = evidence.compare(a, a, np.random.default_rng(0))
    assert (same.gain, same.low, same.high, same.odds) == (0.0, 0.0, 0.0, 1.0)
    assert same.blocks_improved == 0.5


def test_the_same_seed_gives_the_same_numbers():
    assert pair(5, 0.5, 0.6) == pair(5, 0.5, 0.6)


def test_more_trials_widen_the_interval():
    rng = np.random.default_rng(1)
    a, b = (evidence.score([rng.normal(size=(800, 2)) + s * slow(rng, 800)]) for s in (0.0, 0.5))
    one, ten = (evidence.compare(a, b, np.random.default_rng(0), trials=n) for n in (1, 10))
    assert ten.low < one.low < one.gain < one.high < ten.high


def test_difference_far_below_what_both_leave_is_no_proof():
    found = pairs(30.0, 31.0, 50.0)
    assert np.mean([c.odds > 10.0 for c in found]) <= 0.1


@pytest.mark.parametrize("phi", [0.0, 0.5, 0.9])
def test_correlation_time_of_a_first_order_process(phi):
    rng = np.random.default_rng(2)
    x = np.zeros(20000)
    for i in range(1, len(x)):
        x[i] = phi * x[i - 1] + rng.normal()
    assert evidence.correlation_time(x) == pytest.approx((1 + phi) / (1 - phi), rel=0.15)
    x[3000:9000] = np.nan
    assert evidence.correlation_time(x) == pytest.approx((1 + phi) / (1 - phi), rel=0.2)


def test_an_offset_is_correlated_for_ever():
    rng = np.random.default_rng(2)
    x = 10.0 + rng.normal(size=1000)
    assert evidence.correlation_time(x) > 300.0
    assert evidence.correlation_time(np.full(10, np.nan)) == 1.0


@pytest.mark.parametrize("every", [2, 4, 6, 7, 10])
def test_the_correlation_time_counts_measured_samples_whatever_the_rows_between_them(every):
    """The mean of a series is as sure however many empty rows there are."""
    x = slow(np.random.default_rng(3), 3000)[:, 0]
    spread = np.full(len(x) * every, np.nan)
    spread[::every] = x
    assert evidence.correlation_time(x) > 15.0
    assert evidence.correlation_time(spread) == pytest.approx(evidence.correlation_time(x))


@pytest.mark.parametrize("every", [2, 3, 5, 10])
def test_thinning_keeps_the_correlation_time_in_seconds_and_the_number_of_samples(every):
    x = slow(np.random.default_rng(3), 20000)[:, 0]
    thin = np.full((len(x), 1), np.nan)
    thin[::every, 0] = x[::every]
    whole, some = evidence.score([x[:, None]]), evidence.score([thin])
    assert every * some.tau[0, 0] == pytest.approx(whole.tau[0, 0], rel=0.25)
    assert some.n_eff == pytest.approx(whole.n_eff, rel=0.25)


def test_thinning_below_the_correlation_time_counts_every_sample():
    x = slow(np.random.default_rng(3), 200000)[:, 0]
    thin = np.full((len(x), 1), np.nan)
    thin[::200, 0] = x[::200]
    assert evidence.score([thin]).n_eff == pytest.approx(1000, rel=0.2)


@pytest.mark.parametrize("every", [2, 5])
def test_a_slow_error_is_no_more_evidence_where_it_is_measured_more_rarely(every):
    rng = np.random.default_rng(3)
    whole = [size * slow(rng, 20000)[:, :1] for size in (2.0, 4.0)]
    rows = np.arange(20000)[:, None] % every == 0
    gains = []
    for models in (whole, [np.where(rows, x, np.nan) for x in whole]):
        gains.append(evidence.compare(*map(evidence.score, ([m] for m in models)), rng).gain)
    assert gains[1] == pytest.approx(gains[0], rel=0.25)


def test_channels_measured_more_rarely_count_their_samples():
    rng = np.random.default_rng(2)
    x = np.full((3000, 1), np.nan)
    x[::3, 0] = rng.normal(size=1000)
    assert evidence.score([x]).n_eff == pytest.approx(1000, rel=0.1)


def test_divergence_counts_and_gaps_do_not():
    y, p = np.zeros((100, 1)), np.zeros((100, 1))
    y[:10] = np.nan
    p[90:] = np.nan
    p[80] = 1e300
    (r,) = evidence.whiten([y], [p], np.array([1e-3]))
    assert np.isnan(r[:10]).all()
    assert (r[90:] == evidence.LIMIT).all()
    assert r[80] == evidence.LIMIT
    good = evidence.score(evidence.whiten([y], [0.0 * y], np.array([1e-3])))
    assert evidence.compare(good, evidence.score([r]), np.random.default_rng(0)).gain > 0.0


def test_closed_share():
    assert evidence.closed(10.0, 1.0) == 1.0
    assert evidence.closed(10.0, 10.0) == 0.0
    assert evidence.closed(10.0, 0.9) == 1.0
    assert evidence.closed(10.0, 20.0) < 0.0
    assert evidence.closed(1.0, 0.9) == 0.0


@pytest.mark.parametrize("share", [0.0, 0.3, 0.9, 1.0])
def test_what_is_closed_is_the_same_whether_rms_or_residuals_tell_it(share):
    """A share of the rms above noise: noise itself cannot be closed."""
    signs = np.where(np.arange(400) % 2, 1.0, -1.0)[:, None]
    before, after = np.sqrt(1.0 + np.square([40.0, 40.0 * (1.0 - share)]))
    assert evidence.closed(before, after) == pytest.approx(share)
    assert evidence.closed_by([before * signs], [after * signs]) == pytest.approx(share)
    assert evidence.rms([np.array([[3.0, np.nan]]), np.array([[4.0, 4.0]])]) ** 2 == pytest.approx(
        41.0 / 3.0
    )


def test_records_of_different_length_and_one_channel():
    rng = np.random.default_rng(0)
    a = evidence.score([rng.normal(size=(300, 1)), rng.normal(size=(900, 1))])
    b = evidence.score([r + 1.0 for r in a.residuals])
    found = evidence.compare(a, b, rng)
    assert found.odds > 10.0
    assert found.blocks >= evidence.FEW - 1


def test_records_that_do_not_judge_change_nothing():
    rng = np.random.default_rng(0)
    r = rng.normal(size=(800, 2))
    error, empty = slow(rng, 800), np.full((2000, 2), np.nan)
    alone = evidence.compare(*(evidence.score([x]) for x in (r, r + error)), rng)
    beside = evidence.compare(*(evidence.score([empty, x]) for x in (r, r + error)), rng)
    assert (beside.gain, beside.blocks) == (pytest.approx(alone.gain), alone.blocks)
    assert beside.blocks_improved == alone.blocks_improved


def test_parameters_have_their_price():
    rng = np.random.default_rng(0)
    white = rng.normal(size=(800, 2))
    a, b = evidence.score([white]), evidence.score([white + slow(rng, 800)])
    same = evidence.compare(a, a, rng, price=2.0)
    assert same.odds == pytest.approx(np.exp(-2.0))
    found = [evidence.compare(a, b, np.random.default_rng(1), price=p) for p in (-3.0, 0.0, 3.0)]
    assert found[0].odds >= found[1].odds >= found[2].odds > 10.0
    assert found[0].gain == found[2].gain


def test_one_loud_block_does_not_hide_that_all_are_won():
    rng = np.random.default_rng(5)
    white = rng.normal(size=(TICKS, CHANNELS))
    worse = white * 1.25
    worse[700:760] *= 12.0
    first, second = (evidence.score([r]) for r in (white, worse))
    found = evidence.compare(first, second, rng)
    assert found.blocks_improved == 1.0
    assert found.odds > 100.0
    back = evidence.compare(second, first, np.random.default_rng(5))
    assert back.odds < 0.01


def test_few_blocks_count_for_no_more_than_coins():
    rng = np.random.default_rng(0)
    white = rng.normal(size=(1600, 1))
    hit = np.zeros((1600, 1))
    hit[400:440] = 30.0
    found = evidence.compare(evidence.score([white]), evidence.score([white + hit]), rng)
    assert found.gain > 100.0
    assert found.odds < 10.0


def test_too_little_to_resample_says_nothing():
    a, b = evidence.score([np.zeros((1, 1))]), evidence.score([np.ones((1, 1))])
    found = evidence.compare(a, b, np.random.default_rng(0))
    assert found.odds == 1.0
    assert found.low == -np.inf


def test_quiet_channels_do_not_hide_a_loud_one():
    rng = np.random.default_rng(2)
    quiet = 0.2 * rng.normal(size=(500, 8))
    loud = quiet.copy()
    loud[:, 3] *= 12.0
    assert evidence.rms([loud]) < 1.0
    assert evidence.excess([quiet]) == 0.0
    assert evidence.closed_by([loud], [quiet]) == 1.0
    assert evidence.closed_by([loud], [loud]) == 0.0
    assert evidence.closed_by([quiet], [loud]) == 0.0  # there was none to close


def test_blocks_in_which_an_effect_does_not_show_do_not_vote():
    rng = np.random.default_rng(3)
    noise = rng.normal(size=(1600, 1))
    idle = 0.02 * slow(rng, 1600)[:, :1]
    wrong = noise + idle
    wrong[800:900] += 8.0
    over = evidence.compare(evidence.score([noise]), evidence.score([wrong]), rng)
    assert over.blocks_improved == 1.0


def test_noise_of_many_channels_does_not_vote():
    """Two models that differ by fifths of a floor in 40 channels, but for 100 samples."""
    rng = np.random.default_rng(5)
    noise = rng.normal(size=(TICKS, 40))
    right = noise + 0.2 * rng.normal(size=noise.shape)
    wrong = noise + 0.2 * rng.normal(size=noise.shape)
    wrong[400:500] += 5.0
    over = evidence.compare(evidence.score([right]), evidence.score([wrong]), rng)
    assert over.blocks_improved == 1.0


def test_a_price_is_paid_out_of_the_gain_and_not_out_of_what_blocks_allow():
    """Few blocks cap the odds; a parameter must not turn a large gain round below the cap."""
    rng = np.random.default_rng(4)
    right = rng.normal(size=(1600, 1))
    wrong = right.copy()
    wrong[400:600] += 10.0
    a, b = evidence.score([right]), evidence.score([wrong])
    free, paid = (evidence.compare(a, b, np.random.default_rng(0), price=p) for p in (0.0, 4.0))
    assert free.gain > 50.0
    assert paid.odds == pytest.approx(free.odds, rel=0.2)
