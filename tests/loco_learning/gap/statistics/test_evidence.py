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


def odds(a: evidence.Score, b: evidence.Score, rng, price: float = 0.0) -> float:
    """Odds of the first model over the second, which costs less by a price [nat]."""
    mine, other = evidence.log_weights((a, b), 1, (price, 0.0), rng)
    return float(np.exp(mine - other))


def pair(seed: int, a: float, b: float, width: float = 15.0) -> float:
    """Odds between models with systematic errors of sizes `a` and `b` [floors] on one noise."""
    rng = np.random.default_rng(seed)
    white = rng.normal(size=(TICKS, CHANNELS))
    models = [evidence.score([white + size * slow(rng, width=width)]) for size in (a, b)]
    return odds(*models, rng)


def pairs(a: float, b: float, width: float = 15.0) -> np.ndarray:
    return np.array([pair(seed, a, b, width) for seed in range(TRIALS)])


@pytest.mark.parametrize("size", [0.1, 1.0, 30.0])
@pytest.mark.parametrize("width", [4.0, 50.0])
def test_equals_get_odds_near_1(size, width):
    found = pairs(size, size, width)
    assert 0.3 < np.median(found) < 3.0
    assert np.mean(found > 10.0) <= 0.1
    assert np.mean(found < 0.1) <= 0.1


@pytest.mark.parametrize(("right", "wrong"), [(0.0, 0.2), (0.0, 3.0), (0.1, 0.5), (2.0, 4.0)])
def test_the_better_gets_large_odds(right, wrong):
    found = pairs(right, wrong)
    assert np.mean(found > 10.0) >= 0.95


def test_exchange_turns_the_evidence_round():
    rng = np.random.default_rng(3)
    a, b = (evidence.score([rng.normal(size=(400, 2)) + s * slow(rng, 400)]) for s in (0.2, 1.0))
    ab, ba = (odds(*x, np.random.default_rng(0)) for x in ((a, b), (b, a)))
    assert ab == pytest.approx(1.0 / ba, rel=0.05)


def test_the_same_model_twice_is_no_evidence():
    a = evidence.score([np.random.default_rng(0).normal(size=(300, 3))])
    assert odds(a, a, np.random.default_rng(0)) == 1.0


def test_the_same_seed_gives_the_same_numbers():
    assert pair(5, 0.5, 0.6) == pair(5, 0.5, 0.6)


def test_difference_far_below_what_both_leave_is_no_proof():
    found = pairs(30.0, 31.0, 50.0)
    assert np.mean(found > 10.0) <= 0.1


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


@pytest.mark.parametrize("count", [1, 2, 3, 4, 5, 100])
def test_an_offset_alone_is_one_sample_however_often_it_is_measured(count):
    for level in (1e-6, -3.0):
        assert evidence.correlation_time(np.full(count, level)) == pytest.approx(count)
    assert evidence.correlation_time(np.zeros(count)) == 1.0


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
        few, many = (evidence.score([m]).log_likelihood for m in models)
        gains.append(few - many)
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
    assert odds(good, evidence.score([r]), np.random.default_rng(0)) > 2.0


def test_closed_share():
    assert evidence.closed(10.0, 1.0) == 1.0
    assert evidence.closed(10.0, 10.0) == 0.0
    assert evidence.closed(10.0, 0.9) == 1.0
    assert evidence.closed(10.0, 20.0) < 0.0
    assert evidence.closed(1.0, 0.9) == 0.0


@pytest.mark.parametrize("spread", [0.0, 1.0, 6.0])
def test_expected_odds_of_a_gain_and_of_a_loss_are_inverse_and_those_of_its_normal_law(spread):
    for gain in (0.0, 1.0, 5.0, 1e4):
        assert evidence.odds(gain, spread) * evidence.odds(-gain, spread) == pytest.approx(1.0)
    drawn = 3.0 + spread * np.random.default_rng(0).normal(size=100_000)
    mean = np.mean(1.0 / (1.0 + np.exp(-drawn)))
    assert evidence.odds(3.0, spread) / (1.0 + evidence.odds(3.0, spread)) == pytest.approx(
        mean, abs=0.02
    )


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
    assert odds(a, b, rng) > 10.0


def test_records_that_do_not_judge_change_nothing():
    rng = np.random.default_rng(0)
    r = rng.normal(size=(800, 2))
    error, empty = slow(rng, 800), np.full((2000, 2), np.nan)
    alone, beside = (
        odds(*(evidence.score([*more, x]) for x in (r, r + error)), np.random.default_rng(1))
        for more in ([], [empty])
    )
    assert beside == pytest.approx(alone)


def test_parameters_have_their_price():
    rng = np.random.default_rng(0)
    white = rng.normal(size=(800, 2))
    a, b = evidence.score([white]), evidence.score([white + slow(rng, 800)])
    assert odds(a, a, rng, price=2.0) == pytest.approx(np.exp(-2.0))
    found = [odds(a, b, np.random.default_rng(1), price=p) for p in (-3.0, 0.0, 3.0)]
    assert found[0] >= found[1] >= found[2] > 10.0


def test_one_loud_block_does_not_hide_that_all_are_won():
    rng = np.random.default_rng(5)
    white = rng.normal(size=(TICKS, CHANNELS))
    worse = white * 1.25
    worse[700:760] *= 12.0
    first, second = (evidence.score([r]) for r in (white, worse))
    assert odds(first, second, rng) > 100.0
    assert odds(second, first, np.random.default_rng(5)) < 0.01


def test_few_blocks_count_for_no_more_than_coins():
    rng = np.random.default_rng(0)
    white = rng.normal(size=(1600, 1))
    hit = np.zeros((1600, 1))
    hit[400:440] = 30.0
    assert 1.0 < odds(evidence.score([white]), evidence.score([white + hit]), rng) < 10.0


def test_too_little_to_resample_says_nothing():
    a, b = evidence.score([np.zeros((1, 1))]), evidence.score([np.ones((1, 1))])
    assert odds(a, b, np.random.default_rng(0)) <= 2.0


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


def test_a_price_is_paid_out_of_the_gain_and_not_out_of_what_blocks_allow():
    """Few blocks cap the odds; a parameter must not turn a large gain round below the cap."""
    rng = np.random.default_rng(4)
    right = rng.normal(size=(1600, 1))
    wrong = right.copy()
    wrong[400:600] += 10.0
    a, b = evidence.score([right]), evidence.score([wrong])
    free, paid = (odds(a, b, np.random.default_rng(0), price=p) for p in (0.0, 4.0))
    assert free > 10.0 and paid > 0.5 * free
