# SPDX-License-Identifier: Apache-2.0
"""What is worth a search where runs are dear."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from loco_learning.gap.hypotheses import likely
from loco_learning.gap.hypotheses.hypotheses import Hypothesis
from loco_sim.effects.coordinates import Coordinate

JOINTS = [f"j{i}" for i in range(8)]


class Linear:
    """A case in which each effect adds a column of its own, in proportion to its size."""

    def __init__(self, columns, truth, noise=0.1):
        rng = np.random.default_rng(0)
        self.columns = columns
        self.base = noise * rng.standard_normal(200) - sum(v * columns[k] for k, v in truth.items())
        self.forward = SimpleNamespace()

    @property
    def sparse(self):
        return self

    def vector(self, specs, coarse=False):
        return self.base + sum(s["size"] * self.columns[s["name"]] for s in specs)


def hypothesis(effect, low=0.0, size=0.1):
    size = Coordinate("size", size, (1.0,), low, 10.0, strength=True)
    return Hypothesis(effect, "", (), (size,))


def shares(truth, hypotheses):
    rng = np.random.default_rng(1)
    columns = {h.effect: rng.standard_normal(200) for h in hypotheses}
    case = Linear(columns, truth)
    return [likely.share(case, h)[0] for h in hypotheses]


def test_what_is_there_explains_most_whatever_its_size():
    found = shares({"b": 2.0}, [hypothesis(name) for name in "abc"])
    assert found[1] > 0.95
    assert max(found[0], found[2]) < 0.2


def test_a_forbidden_sign_explains_nothing_and_an_allowed_one_all():
    (never,) = shares({"a": -1.0}, [hypothesis("a")])
    (both,) = shares({"a": -1.0}, [hypothesis("a", low=-10.0)])
    assert never == 0.0
    assert both > 0.95


class Bounded(Linear):
    """Beside the effect something is refitted, within bounds."""

    def __init__(self, beside, *more):
        super().__init__(*more)
        self.beside = beside

    def vector(self, specs, coarse=False):
        sizes = [(s[k], self.columns[k]) for s in specs for k in self.columns]
        left = self.base + sum(size * column for size, column in sizes)
        by = -(left @ self.beside) / (self.beside @ self.beside + 1.0)
        return left + np.clip(by, -2.5, 2.5) * self.beside


@pytest.mark.parametrize("seed", range(1, 4))
def test_sizes_count_together_and_not_one_by_one(seed):
    """Each alone drives what is refitted beside it to a bound, both together do not."""
    rng = np.random.default_rng(seed)
    beside, a, b = 20.0 * rng.standard_normal((3, 200))
    columns = {"a": a + 3.0 * beside, "b": b - 3.0 * beside}
    case = Bounded(beside, columns, {"a": 0.010, "b": 0.012}, 0.3)
    sizes = [Coordinate(k, 1.0, (1.0,), -10.0, 10.0, strength=True) for k in columns]
    share, x = likely.share(case, Hypothesis("both", "", (), tuple(sizes)))
    assert share > 0.4
    assert x == pytest.approx([0.010, 0.012], rel=0.15)


class Loaded(Linear):
    """A load whose weight shows in one column, and its moment in another."""

    def vector(self, specs, coarse=False):
        left = self.base
        for s in specs:
            left = left + s["mass"] * (self.columns["weight"] + s["at"] * self.columns["moment"])
        return left


@pytest.mark.parametrize("at", [-1.5, 0.4, 2.0])
def test_a_load_is_found_where_it_is_and_not_at_its_first_guess(at):
    rng = np.random.default_rng(5)
    columns = {"weight": rng.standard_normal(200), "moment": 4.0 * rng.standard_normal(200)}
    case = Loaded(columns, {"weight": 2.0, "moment": 2.0 * at})
    load = (Coordinate("mass", 1.0, (1.0,), 0.0, 10.0, strength=True),
            Coordinate("at", 1.0, (0.0,), -3.0, 3.0))  # fmt: skip
    share, x = likely.share(case, Hypothesis("load", "", (), load))
    assert share > 0.9
    assert x == pytest.approx([2.0, at], rel=0.2)


def test_a_search_starts_with_a_load_where_it_was_found():
    rng = np.random.default_rng(6)
    columns = {"weight": rng.standard_normal(200), "moment": 4.0 * rng.standard_normal(200)}
    case = Loaded(columns, {"weight": 2.0, "moment": 3.0})
    case.forward.channels, case.fit_rows, case.whitened = [], [], lambda specs: []
    load = (Coordinate("mass", 1.0, (1.0,), 0.0, 10.0, strength=True),
            Coordinate("at", 1.0, (0.0, 1.0), -3.0, 3.0))  # fmt: skip
    (kept,), *_ = likely.likely_hypotheses(
        case, [Hypothesis("load", "", (), load)], lambda f, rows: [f(case, *row) for row in rows]
    )
    assert kept.key == Hypothesis("load", "", (), load).key
    ((mass, at),) = kept.starts()
    assert mass == 1.0 and at == pytest.approx(1.5, rel=0.2)


def case_with(excess):
    """A case whose joints are so far off [floors]."""
    channels = [SimpleNamespace(signal="q", name=j) for j in JOINTS]
    rows = np.tile(np.array(excess, float), (50, 1))
    return SimpleNamespace(
        forward=SimpleNamespace(channels=channels),
        fit_rows=[np.ones(50, bool)],
        whitened=lambda specs: [rows],
    )


def test_joints_that_stand_out_are_looked_at_alone_and_none_where_all_do():
    assert likely.conspicuous(case_with([1, 1, 5, 1, 1, 1, 1, 1])) == {"j2"}
    assert likely.conspicuous(case_with([5] * 8)) == set()


def test_what_explains_most_is_told_with_its_size():
    columns = {"a": np.r_[np.ones(100), np.zeros(100)], "b": np.r_[np.zeros(100), np.ones(100)]}
    case = Linear(columns, {"b": 2.0}, noise=0.0)
    case.forward.channels, case.fit_rows, case.whitened = [], [], lambda specs: []
    both = [hypothesis(name) for name in "ab"]
    *_, first = likely.likely_hypotheses(
        case, both, lambda f, rows: [f(case, *row) for row in rows]
    )
    ((best, x),) = first
    assert best.effect == "b"
    assert best.term(x).params["size"] == pytest.approx(2.0)
