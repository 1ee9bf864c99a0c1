# SPDX-License-Identifier: Apache-2.0
"""On linear models everything that identifying says can be known."""

from __future__ import annotations

import numpy as np
import pytest

from loco_learning.gap.statistics import evidence, identify

N = 4000
TIME = np.linspace(0.0, 20.0, N)


def columns(*kinds) -> np.ndarray:
    return np.stack([kind(TIME) for kind in kinds], axis=1)


def test_errors_are_those_of_least_squares():
    j = columns(np.sin, np.cos, lambda t: 0.2 * np.sin(3 * t) + 0.1 * np.cos(t))
    rng = np.random.default_rng(0)
    fits = np.linalg.lstsq(j, rng.normal(size=(N, 400)), rcond=None)[0]
    found = identify.analyse(j, ["a", "b", "c"])
    np.testing.assert_allclose(found.errors, fits.std(1), rtol=0.15)
    assert (found.errors >= found.errors_alone - 1e-12).all()


def test_errors_cover_with_correlated_noise():
    """Intervals hold the truth when the residual is a first-order process."""
    rng = np.random.default_rng(1)
    j = columns(lambda t: np.sign(np.sin(t)), lambda t: np.sin(0.7 * t))
    inside = []
    for _ in range(100):
        noise = rng.normal(size=N)
        for i in range(1, N):
            noise[i] += 0.8 * noise[i - 1]
        fit = np.linalg.lstsq(j, noise, rcond=None)[0]
        score = evidence.score([(noise - j @ fit)[:, None]])
        errors = identify.analyse(j, ["a", "b"], weight=identify.weights(score)).errors
        inside.append(np.abs(fit) < 1.96 * errors)
    assert 0.88 <= np.mean(inside) <= 1.0


def test_the_worst_direction_is_told_in_words():
    j = columns(np.sin, lambda t: -np.sin(t) + 0.01 * np.cos(t), lambda t: np.cos(2 * t))
    found = identify.analyse(j, ["payload.mass", "torque_constant", "friction"])
    assert found.worst in (
        "payload mass up with torque constant up",
        "torque constant up with payload mass up",
    )
    assert found.worst_error > 10 * found.errors[2]
    assert found.condition > 10.0
    down = identify.analyse(j * [1, -1, 1], ["a", "b", "c"])
    assert down.worst in ("a up with b down", "b up with a down")
    assert [set(p[:2]) for p in found.alike] == [{"payload.mass", "torque_constant"}]
    assert found.alike[0][2] < -identify.SAME_DIRECTION


@pytest.mark.parametrize("factor", [0.01, 100.0])
def test_errors_scale_as_the_noise_and_directions_stay(factor):
    """The same data with the noise divided by a factor."""
    j = columns(np.sin, lambda t: -np.sin(t) + 0.01 * np.cos(t))
    found, scaled = (identify.analyse(by * j, ["a", "b"]) for by in (1.0, factor))
    assert scaled.worst == found.worst
    assert scaled.condition == pytest.approx(found.condition)
    assert scaled.worst_error == pytest.approx(found.worst_error / factor)
    np.testing.assert_allclose(scaled.errors, found.errors / factor)


def test_what_nuisance_can_imitate_is_no_likeness():
    """Two effects that share only what a nuisance explains are told apart, and inversely."""
    j = columns(
        lambda t: 10 * np.sin(t) + np.cos(3 * t),
        lambda t: 10 * np.sin(t) + np.cos(5 * t),
        np.sin,
    )
    names = ["a", "b", "gain"]
    assert identify.analyse(j[:, :2], names[:2]).alike
    found = identify.analyse(j, names, nuisance=["gain"])
    assert found.alike == ()
    assert found.cosines.shape == (2, 2)


def test_dead_and_weak_parameters_are_listed():
    j = columns(np.sin, np.zeros_like, lambda t: 1e-3 * np.cos(t))
    found = identify.analyse(j, ["a", "b", "c"])
    assert (found.dead, found.weak) == (("b",), ("c",))
    assert np.isinf(found.errors[1])
    assert "b" not in found.worst.split()
    nothing = identify.analyse(np.zeros((10, 1)), ["a"])
    assert nothing.dead == ("a",)


@pytest.mark.parametrize(("error", "weak"), [(0.9, False), (1.0, False), (1.1, True)])
def test_a_parameter_is_weak_if_its_error_is_larger_than_its_typical_size(error, weak):
    found = identify.analyse(np.full((4, 1), 0.5 / error), ["a"])
    assert found.errors == pytest.approx(error) and bool(found.weak) is weak


def test_identical_columns_do_not_break():
    found = identify.analyse(columns(np.sin, np.sin), ["a", "b"])
    assert (found.errors > 1e3).all()
    assert found.alike[0][2] == pytest.approx(1.0)


def test_rows_not_measured_change_nothing():
    j = columns(np.sin, np.cos)
    holes = np.concatenate([j, np.full((50, 2), np.nan)])
    np.testing.assert_allclose(
        identify.analyse(holes, "ab").errors, identify.analyse(j, "ab").errors
    )


def test_weights_follow_flat():
    r = np.random.default_rng(0).normal(size=(100, 2))
    r[:5, 1] = np.nan
    score = evidence.score([r, 3.0 * r])
    w, x = identify.weights(score), identify.pack(score.residuals)
    assert w.shape == x.shape
    assert (w[np.isnan(x)] == 0.0).all()
    assert (w[np.isfinite(x)] > 0.0).all()


def test_stability_tells_one_parameter_from_several():
    rng = np.random.default_rng(3)
    j = columns(np.sin, np.cos)
    groups = np.arange(N) // 1000
    noise = rng.normal(size=N)
    same = identify.stability(j, noise, groups)
    assert same.probability.min() > 0.01
    assert same.spread.max() < 0.1
    moving = np.array([-1.0, -0.5, 0.5, 1.0])[groups]
    found = identify.stability(j, noise - moving * j[:, 0], groups)
    assert found.probability[0] < 1e-6
    assert found.spread[0] == pytest.approx(moving[::1000].std(ddof=1), rel=0.3)
    assert found.probability[1] > 0.01
    np.testing.assert_allclose(found.shifts[:, 0], moving[::1000], atol=0.2)


def test_rows_of_a_weight_are_rows_times_its_root_and_each_part_is_fitted_by_itself():
    """Noise ten times larger in some rows must not move what each part of the data says."""
    rng = np.random.default_rng(4)
    j, groups = columns(np.sin, np.cos), np.arange(N) // 1000
    weight = np.where(np.arange(N) % 3, 1.0, 0.01)
    residual = rng.normal(size=N) / np.sqrt(weight) + groups * j[:, 1]
    found = identify.stability(j, residual, groups, weight)
    root = np.sqrt(weight)
    scaled = identify.stability(j * root[:, None], residual * root, groups)
    for name in ("shifts", "errors", "spread", "probability"):
        np.testing.assert_allclose(getattr(found, name), getattr(scaled, name))
    for part in range(4):
        rows = groups == part
        alone = np.linalg.lstsq((j * root[:, None])[rows], -(residual * root)[rows], rcond=None)[0]
        np.testing.assert_allclose(found.shifts[part], alone)
        np.testing.assert_allclose(
            found.errors[part], identify.standard_errors(j[rows], weight[rows])
        )


def test_what_nuisance_can_imitate_is_told():
    j = columns(np.sin, lambda t: np.sin(t) + 0.1 * np.cos(t), np.cos)
    found = identify.analyse(j, ["gain", "payload", "friction"], ["gain"])
    assert found.imitated["payload"] == pytest.approx(1.0 / np.hypot(1.0, 0.1), rel=0.01)
    assert found.imitated["friction"] < 0.1 and set(found.imitated) == {"payload", "friction"}
