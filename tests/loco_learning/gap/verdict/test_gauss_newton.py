# SPDX-License-Identifier: Apache-2.0
"""An effect and a value of the robot that nearly cancel, along a line that is not straight."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from loco_learning.gap.statistics import evidence
from loco_learning.gap.verdict import sensitivity
from loco_learning.gap.verdict.gauss_newton import gauss_newton

from ..laws import COULOMB, TORQUE, fitted, hypothesis

ROWS, BEND, SPREAD, FIT = 500, 0.2, 0.02, 400
TIME = np.linspace(0.0, 20.0, ROWS)
BIAS = hypothesis("torque_bias", TORQUE)
NOISE = np.random.default_rng(3).normal(size=ROWS)


class Valley:
    """A loud response that an effect and a mass share, and a faint one of the mass alone.

    Args:
        step: Width of the steps in which the mass acts; 0 for none.
    """

    cap, ground, rounds, bends = 1e6, False, False, True

    def __init__(self, step=0.0):
        self.step, self.forward = step, SimpleNamespace(begun=lambda: [[]])
        self.loose = SimpleNamespace(
            names=["mass"], nominal=np.ones(1), spread=np.array([SPREAD]), of=np.zeros(1, int),
            at=np.zeros(1), reach=(np.array([-2.5]), np.array([2.5])),
        )  # fmt: skip

    def kept(self):
        return self

    def corrected(self, specs, values):
        return self

    def relined(self, specs):
        return self

    def quickly(self, specs):
        return False

    def masked(self, residuals, only, held):
        rows = np.arange(ROWS)[:, None] >= FIT
        return [np.where(rows == held, r, np.nan) for r in residuals]

    def judged(self, residuals):
        return evidence.score(self.masked(residuals, [0], held=True))

    def whitened(self, specs, values, coarse=False):
        size, mass = specs[0]["torque"] / 0.05, (values.get("mass", 1.0) - 1.0) / SPREAD
        if self.step:
            mass = self.step * np.floor(mass / self.step)
        loud = 300.0 * (size - (1.0 + 0.5 * mass + BEND * mass**2)) * np.sin(TIME)
        return [(loud + 5.0 * (mass - 0.3) * np.cos(TIME) + NOISE)[:, None]]

    def simulated(self, specs, overrides, at):
        values = {"mass": 1.0 + SPREAD * at[0]}
        return self.whitened(specs, values), values, 0.5 * float(at @ at), ()


def at(case, mass, law=BIAS):
    """The model on the bottom of the valley at a mass [deviations]."""
    size = 1.0 + 0.5 * mass + BEND * mass**2
    one = replace(fitted(law), parts=((law, (size,)),))
    whole, values, pull, _ = case.simulated(one.specs, {}, np.array([mass]))
    return replace(one, whole=tuple(whole), loose=values, pull=pull)


@pytest.mark.parametrize("start", [-1.5, -0.5, 1.0, 2.0])
def test_a_fit_comes_to_the_lowest_point_of_a_bent_valley(start):
    case = Valley()
    best = gauss_newton(case, at(case, start))
    true = 1.0 + 0.5 * 0.3 + BEND * 0.3**2
    assert best.specs[0]["torque"] == pytest.approx(0.05 * true, rel=0.02)
    (strength,) = sensitivity.sensitivities(case, best, wider=True)[0][BIAS.key]
    assert strength.low < 0.05 * true < strength.high
    assert strength.high - strength.low < 0.2 * 0.05


def test_a_fit_that_is_at_the_lowest_point_stays_there():
    case = Valley()
    best = gauss_newton(case, at(case, 0.3))
    again = gauss_newton(case, best)
    assert again.parts == best.parts and again.loose == best.loose


def test_a_fit_of_dry_friction_which_has_no_derivatives_stays():
    case = Valley()
    friction = at(case, -0.5, COULOMB)
    assert gauss_newton(case, friction) is friction


def test_columns_are_derivatives_unless_the_response_has_steps():
    """The secant of a bent line hides that two values cancel."""
    case, mass = Valley(), 0.5
    _, (uncertain, now) = sensitivity.columns(case, at(case, mass))
    slope = -300.0 * (0.5 + 2.0 * BEND * mass) * np.sin(TIME) + 5.0 * np.cos(TIME)
    assert now == pytest.approx([mass])
    assert uncertain[:, 0] == pytest.approx(slope, abs=0.01 * 300.0 * BEND)
    case = Valley(step=0.25)
    _, (uncertain, _) = sensitivity.columns(case, at(case, -0.9))
    secant = -300.0 * (0.5 - BEND) * np.sin(TIME) + 5.0 * np.cos(TIME)
    assert uncertain[:, 0] == pytest.approx(secant)


def test_rows_that_were_not_fitted_make_no_size_surer():
    """A tenth of the rows, fitted, leaves an interval three times as long."""
    case, short = Valley(), Valley()
    short.masked = lambda residuals, only, held: [
        np.where((np.arange(ROWS)[:, None] >= FIT // 10) == held, r, np.nan) for r in residuals
    ]
    wide, known = (
        sensitivity.sensitivities(each, at(each, 0.3), wider=True)[0][BIAS.key][0]
        for each in (short, case)
    )
    assert wide.high - wide.low > 1.5 * (known.high - known.low)


class Stale(Valley):
    """A valley whose initial states are fitted by how they act without the effect: a mass helps."""

    stale = True

    def relined(self, specs):
        case = Stale(self.step)
        case.stale = False
        return case

    def whitened(self, specs, values, coarse=False):
        (left,) = super().whitened(specs, values, coarse)
        mass = (values.get("mass", 1.0) - 1.0) / SPREAD
        return [left + self.stale * 90.0 * (1.0 + 0.4 * mass) * np.sin(7.0 * TIME)[:, None]]


def test_initial_states_are_fitted_by_how_they_act_beside_the_effects():
    """A payload of 1.1 kg became one of 1.0 kg, with ten values of the robot on their bounds."""
    case = Stale()
    start = at(case.relined([]), 0.3)
    assert gauss_newton(case, start).loose["mass"] == pytest.approx(start.loose["mass"], abs=1e-3)
