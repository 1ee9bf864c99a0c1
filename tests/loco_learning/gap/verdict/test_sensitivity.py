# SPDX-License-Identifier: Apache-2.0
"""Intervals of the parameters of an effect, from what the residuals change with each of them."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from loco_learning.gap.statistics import evidence, identify
from loco_learning.gap.verdict import sensitivity

from ..laws import COULOMB, STRIBECK, TORQUE, fitted, hypothesis

KP, ROWS = "drives.knee.kp", 500
TIME = np.linspace(0.0, 20.0, ROWS)


class Straight:
    """A case whose residuals are straight lines in the coordinates of frictions and in a gain.

    Args:
        size: What changes per typical torque, (T,).
        shape: What changes per unit of the logarithm of the velocity, (T,).
        gain: What changes per unit of the logarithm of the gain, (T,).
        dry: What changes per typical torque of Coulomb friction, (T,).
        off: A residual that no parameter changes, (T,).
    """

    cap, ground, rounds = 1e6, False, False

    def __init__(self, size, shape, gain, off=0.0, dry=0.0):
        self.lines, self.off, self.dry = (size, shape, gain), off, dry
        self.forward = SimpleNamespace(begun=lambda: [[]])

    def kept(self):
        return self

    def masked(self, residuals, only, held):
        return residuals

    def quickly(self, specs):
        return False

    def whitened(self, specs, overrides, coarse=False):
        row = self.off + np.log(overrides.get(KP, 1.0)) * self.lines[2]
        for spec in specs:
            if "velocity" in spec:
                row = row + spec["torque"] / 0.05 * self.lines[0]
                row = row + np.log(spec["velocity"] / 0.1) * self.lines[1]
            else:
                row = row + spec["torque"] / 0.05 * self.dry
        return [np.stack([row, np.zeros(ROWS)], axis=1)]


def model():
    return replace(fitted(STRIBECK), overrides={KP: 1.0})


@pytest.mark.parametrize("off", [0.0, 30.0 * np.cos(3.0 * TIME)])
def test_sensitivities_of_a_straight_model_are_its_lines_whatever_is_left(off):
    lines = np.sin(TIME), np.cos(TIME), np.sin(2.3 * TIME)
    _, analysis = sensitivity.sensitivities(Straight(*lines, off), model())
    weight = identify.weights(model().score)[::2]
    known = [1.0 / np.sqrt(weight @ np.square(line)) for line in lines]
    assert analysis.errors_alone == pytest.approx(known)


@pytest.mark.parametrize("by", [0.01, 1.0, 100.0])
def test_intervals_are_as_much_wider_as_lines_are_weaker(by):
    sizes = []
    for factor in (1.0, by):
        lines = (5.0 * factor * np.sin(k * TIME) for k in (1.0, 1.7, 2.3))
        found = sensitivity.sensitivities(Straight(*lines), model())[0][STRIBECK.key][0]
        sizes.append(found.high - found.low)
    assert sizes[0] == pytest.approx(by * sizes[1])


class Repeated(Straight):
    """The same in several records."""

    def __init__(self, count, *lines):
        super().__init__(*lines)
        self.count, self.forward = count, SimpleNamespace(begun=lambda: [[]] * count)

    def whitened(self, specs, overrides, coarse=False):
        return super().whitened(specs, overrides, coarse) * self.count


@pytest.mark.parametrize("records", [4, 9])
@pytest.mark.parametrize("apart", [0.0, 2.0, 4.0])
def test_a_size_that_drifts_in_each_record_is_as_sure_as_the_mean_of_all_halves(apart, records):
    """Each record as a whole says the same, as where friction falls while a gear warms up."""
    lines = [100.0 * np.sin(k * TIME) for k in (1.0, 1.7, 2.3)]
    drift = np.where(np.arange(ROWS) < ROWS // 2, 0.5, -0.5) * apart * lines[0]
    noise = np.random.default_rng(0).normal(size=(records, ROWS, 2))
    whole = tuple(r + drift[:, None] * [1.0, 0.0] for r in noise)
    at = replace(model(), overrides={}, whole=whole, held=evidence.score(whole))
    found = sensitivity.sensitivities(Repeated(records, *lines), at)[0][STRIBECK.key][0]
    spread = TORQUE.size * apart * 0.5 * np.sqrt(2.0 * records / (2.0 * records - 1.0))
    assert found.spread == pytest.approx(spread, rel=0.05)
    half = sensitivity.NORMAL * spread / np.sqrt(2.0 * records)
    if apart:
        assert 0.5 * (found.high - found.low) == pytest.approx(half, rel=0.05)
    else:
        assert 0.5 * (found.high - found.low) < 0.01 * TORQUE.size


@pytest.mark.parametrize("x", [0.0, 1.0, 200.0])
def test_a_size_on_its_bound_is_as_sure_as_any(x):
    at = replace(model(), parts=((STRIBECK, (x, 0.0)),))
    case = Straight(*(5.0 * np.sin(k * TIME) for k in (1.0, 1.7, 2.3)))
    found, known = (sensitivity.sensitivities(case, m)[0][STRIBECK.key][0] for m in (at, model()))
    assert found.high - found.low == pytest.approx(known.high - known.low)


def test_each_effect_has_the_intervals_of_its_own_in_any_order():
    case = Straight(*(5.0 * np.sin(k * TIME) for k in (1.0, 1.7, 2.3)), dry=np.sin(4.1 * TIME))
    parts = (STRIBECK, (1.0, 0.0)), (COULOMB, (1.0,))
    first, second = (
        sensitivity.sensitivities(case, replace(model(), parts=order))[0]
        for order in (parts, parts[::-1])
    )
    for key in (STRIBECK.key, COULOMB.key):
        widths = [[e.high - e.low for e in found[key]] for found in (first, second)]
        assert widths[0] == pytest.approx(widths[1])
    widths = [found[0].high - found[0].low for found in (first[COULOMB.key], first[STRIBECK.key])]
    assert widths[0] == pytest.approx(5.0 * widths[1], rel=0.2)


@pytest.mark.parametrize("weak", [0.02, 1.0])
def test_profiles_of_straight_lines_are_the_intervals_of_derivatives(weak, monkeypatch):
    monkeypatch.setattr(
        sensitivity.doubt, "columns", lambda *args: sensitivity.doubt.none(2 * ROWS)
    )
    either = hypothesis("torque_bias", replace(TORQUE, low=-1e3, high=1e3))
    one = replace(model(), parts=((either, (0.01,)),), overrides={})
    case = Straight(0.0, 0.0, 0.0, dry=weak * np.sin(TIME))
    derived, profiled = (
        sensitivity.sensitivities(case, one, wider=doubtful)[0][either.key][0]
        for doubtful in (False, True)
    )
    assert (profiled.low, profiled.high) == pytest.approx((derived.low, derived.high))


def test_a_size_that_only_a_shape_or_a_gain_may_replace_is_there_or_not():
    """A shape cannot make up for an effect that is absent; a value of the robot can."""
    size, like = 5.0 * np.sin(TIME), 5.0 * np.sin(TIME) + 0.01 * np.cos(TIME)
    other = 5.0 * np.sin(2.3 * TIME)
    for lines, there in (((size, like, other), True), ((size, other, like), False)):
        estimates, _ = sensitivity.sensitivities(Straight(*lines), model())
        strength, shape = estimates[STRIBECK.key]
        assert strength.low < 0.0 < strength.high
        assert bool(strength.excludes_absent) is there and not shape.excludes_absent


def test_intervals_are_in_the_unit_and_may_pass_zero():
    strength, shape = sensitivity.estimates(
        STRIBECK, [1.0, 0.0], np.array([2.0, 0.98]), np.array([0.2, 0.2]), np.array([2.0, np.nan])
    )
    assert strength.value == pytest.approx(0.05)
    assert strength.low == pytest.approx(0.05 - 2.0 * 0.05)
    assert not strength.excludes_absent
    surer, _ = sensitivity.estimates(STRIBECK, [1.0, 0.0], np.array([0.5, 0.98]), *np.zeros((2, 2)))
    assert surer.low == pytest.approx(0.5 * 0.05) and surer.excludes_absent
    assert (strength.absent, strength.sign) == (0.0, 1)
    assert strength.spread == pytest.approx(0.01)
    assert shape.absent is None
    assert shape.low == pytest.approx(0.1 * np.exp(-0.98))
    wide = np.array([np.inf, 1.0])
    unknown, _ = sensitivity.estimates(STRIBECK, [1.0, 0.0], wide, np.zeros(2), wide)
    assert (unknown.low, unknown.high) == (-np.inf, np.inf) and not unknown.excludes_absent


def test_an_effect_of_which_size_and_shape_show_together_is_there():
    """A cable's stiffness and free length may show as one force: neither is known by itself."""
    wide, sure = np.array([9.0, 9.0]), np.array([0.1, np.nan])
    strength, shape = sensitivity.estimates(STRIBECK, [1.0, 0.0], wide, np.zeros(2), sure)
    assert strength.low < 0.0 < strength.high
    assert strength.excludes_absent and not shape.excludes_absent


def test_halves_follow_flat():
    whole = [np.zeros((4, 2)), np.zeros((2, 2))]
    assert sensitivity.halves(whole).tolist() == [0] * 4 + [1] * 4 + [2] * 2 + [3] * 2
