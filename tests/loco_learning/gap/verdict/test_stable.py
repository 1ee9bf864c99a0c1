# SPDX-License-Identifier: Apache-2.0
"""A name that hangs on a setting is none."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from loco_learning.gap.fitting.fit import Fitted
from loco_learning.gap.hypotheses.hypotheses import Hypothesis
from loco_learning.gap.statistics import evidence
from loco_learning.gap.verdict import stable
from loco_learning.gap.verdict.decide import AMBIGUOUS, MORE, NAMED, UNKNOWN, Decision, Ruling

RUBS, LAGS = "coulomb_friction", "actuator_lag"


def fitted(whole, *effects):
    parts = tuple((Hypothesis(name, "knee", (), ()), ()) for name in effects)
    return Fitted(parts, {}, 1.0, evidence.score(whole), tuple(whole), 0.0)


def noise(size, seed=0):
    """Residuals of three records, with an error of a size beside the noise in each."""
    rng = np.random.default_rng(seed)
    wave = np.sign(np.sin(np.arange(400) * 0.3))[:, None]
    return [rng.normal(size=(400, 1)) + s * wave for s in size]


@pytest.fixture
def table(monkeypatch):
    """Answers under settings: sizes of the error that each model leaves, per record."""

    def make(best, base, *rivals):
        models = [fitted(noise(best), RUBS), fitted(noise(base))]
        models += [fitted(noise(r), LAGS) for r in rivals]
        records = [SimpleNamespace(name=n) for n in ("chirp", "steps", "ramp")]
        search = SimpleNamespace(
            case=SimpleNamespace(records=records), setting=None,
            each=lambda function, tasks: (task[0].whole for task in tasks),
        )  # fmt: skip
        return stable.rows(search, models[0], models[1], models[2:], 0)

    return make


def decision(verdict=NAMED):
    ruling = Ruling(RUBS, "knee", NAMED, 100.0, (), (), (), "It closes 90 % of the gap.")
    return Decision(verdict, (ruling,), True, "With coulomb_friction the gap falls.")


@pytest.mark.parametrize("verdict", [NAMED, MORE])
def test_a_name_that_stays_keeps_its_verdict(table, verdict):
    rows = table([0.0, 0.0, 0.0], [5.0, 5.0, 5.0], [2.0, 2.0, 2.0])
    assert [r.vary for r in rows] == ["split"] * 3 + ["stretch"] * 2 + ["floor"] * 2
    assert {r.names for r in rows} == {(RUBS,)} and not any(r.flips for r in rows)
    given = decision(verdict)
    assert stable.downgraded(given, rows) is given


def test_a_record_in_which_a_rival_wins_makes_the_name_ambiguous(table):
    rows = table([0.0, 0.0, 3.0], [5.0, 5.0, 5.0], [2.0, 2.0, 0.0])
    (flip,) = [r for r in rows if r.flips]
    assert (flip.vary, flip.setting, flip.names) == ("split", "ramp judges", (LAGS,))
    said = stable.downgraded(decision(), rows)
    assert said.verdict == AMBIGUOUS and said.names == ()
    assert said.ambiguous == ((LAGS, RUBS),) and "ramp judges" in said.evidence
    assert stable.downgraded(decision(UNKNOWN), rows).verdict == UNKNOWN


def test_a_record_in_which_nothing_is_better_counts_too(table):
    rows = table([0.0, 0.0, 5.0], [5.0, 5.0, 0.0])
    said = stable.downgraded(decision(), rows)
    assert said.verdict == AMBIGUOUS and "nothing has odds" in said.evidence


def test_a_record_that_says_nothing_flips_nothing(table):
    rows = table([0.0, 0.0, 0.0], [5.0, 5.0, 0.0], [4.0, 4.0, 0.0])
    assert not any(r.flips for r in rows)
