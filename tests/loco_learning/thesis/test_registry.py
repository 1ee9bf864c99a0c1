# SPDX-License-Identifier: Apache-2.0
"""The registry of claims: every row has a rule, a measure and runs; rules give verdicts."""

import dataclasses
import math
import types

import numpy as np
import pytest

from loco_control.exceptions import NameUnknownError
from loco_learning.calibration.results import Comparison
from loco_learning.study.case import CaseResult
from loco_learning.thesis import chapter5, chapter7, chapter8, evidence, registry
from loco_learning.thesis.evidence import Entry, Evidence
from loco_learning.thesis.registry import AGREES, DISAGREES, MEASURES, OPEN, Claim

CLAIMS = {claim.number: claim for claim in registry.claims()}
MODULES = (chapter5, chapter7, chapter8)


def test_all_47_claims_are_there():
    counts = {chapter: sum(n.startswith(f"{chapter}.") for n in CLAIMS) for chapter in "56789"}
    assert counts == {"5": 8, "6": 16, "7": 15, "8": 6, "9": 2}


@pytest.mark.parametrize("number", CLAIMS)
def test_a_claim_has_a_measure_a_rule_and_runs(number):
    claim = CLAIMS[number]
    for plan in ("quick", "medium", "full"):
        assert set(claim.evidence) & set(evidence.plan(plan))
    if claim.measure != "msd":
        assert claim.measure in MEASURES and claim.rule and claim.says and claim.item
        assert all(low <= high for low, high in claim.rule.values())


@pytest.mark.parametrize("plan", ["quick", "medium", "full", "mujoco"])
def test_every_study_of_a_plan_reads_and_serves_a_claim(plan):
    used = {name for claim in CLAIMS.values() for name in claim.evidence}
    for name, entry in evidence.plan(plan).items():
        assert name in used
        if entry.study:
            assert entry.load().variants


def test_a_plan_that_is_unknown_is_said():
    with pytest.raises(NameUnknownError, match="no plan named 'fast'"):
        evidence.plan("fast")


@pytest.mark.parametrize(
    ("value", "word"),
    [(1.0, AGREES), (2.0, AGREES), (2.1, DISAGREES), (0.0, DISAGREES), (math.nan, OPEN)],
)
def test_a_rule_gives_a_verdict(value, word, monkeypatch):
    monkeypatch.setitem(MEASURES, "mine", lambda found: {"a": value, "other": 9.0})
    claim = Claim("0.0", "here", "it is so", ("x",), "mine", {"a": (1.0, 2.0)}, "because")
    verdict = registry.judge(claim, None)
    assert verdict.verdict == word and verdict.wanted == "a 1 to 2"
    assert verdict.why == ("because" if word == DISAGREES else "")


def test_what_was_not_run_is_not_decided(tmp_path):
    nothing = Evidence(evidence.plan("quick"), tmp_path)
    for claim in CLAIMS.values():
        if claim.measure not in ("msd", "operations", "force_filter"):
            assert registry.judge(claim, nothing).verdict == OPEN, claim.number


# ---- measures on made-up results, whose answer is known


def case(variant="reflex", seed=0, verdict=None, at=None, **phases):
    return CaseResult("c", variant, seed, {}, verdict or {}, phases, at=at or {})


class Given(Evidence):
    """Evidence whose cases are given."""

    def __init__(self, variants=(), **cases):
        super().__init__({}, None)
        self._cases, self._variants = cases, variants

    def study(self, name):
        @dataclasses.dataclass
        class Some:
            variants: tuple = self._variants

        return Some(), self._cases[name]


def curve(**closed):
    """Cases over stiffness: the open loop is 1 everywhere, the closed one as given."""
    count = len(next(iter(closed.values())))
    return [
        case(at={"kp": kp}, train=dict.fromkeys(closed, 1.0),
             test={name: values[i] for name, values in closed.items()})
        for i, kp in enumerate(np.linspace(100.0, 1000.0, count))
    ]  # fmt: skip


def test_a_slip_is_seen_at_the_lag_that_the_error_found():
    """A bump that comes 0.1 s late is the robot's; one at another place is not."""
    t = np.arange(200) / 100.0  # one period of 2 s
    sine = np.sin(np.pi * t)

    def bump(at):
        return (sine[:, None] * 0.1 + np.exp(-(((t - at) / 0.05) ** 2))[:, None]).repeat(4, 1)

    curves = {
        "robot": np.roll(bump(1.0), 10, axis=0),
        "default": bump(1.5),
        "calibrated": bump(1.0),
    }
    result = Comparison("sine", True, 2.0, 9, {}, {}, 0.1, 0.1, "", "", curves)

    class Fitted(Evidence):
        def other(self, name):
            return types.SimpleNamespace(comparisons=[result])

    found = MEASURES["slip_is_seen"](Fitted({}, None))
    assert found["calibrated"] == pytest.approx(1.0) and found["default"] < 0.5


def test_an_exponential_cost_is_found():
    kp = np.linspace(100.0, 1000.0, 7)
    found = MEASURES["cost_rises"](Given(stiffness=curve(cost_of_transport=np.exp(kp / 500.0))))
    assert found["r2"] == pytest.approx(1.0)
    assert found["slope_per_1000"] == pytest.approx(2.0)


def test_crossing_and_never_better_read_the_same_ratio():
    given = Given(stiffness=curve(cost_of_transport=[0.8, 1.0, 3.0], speed=[1.0, 1.2, 0.5]))
    assert MEASURES["crossing"](given) == {
        "ratio_softest": 0.8,
        "ratio_stiffest": 3.0,
        "least": 0.8,
    }
    assert MEASURES["never_better"](given) == {"least_cost_ratio": 0.8, "speed_ratio": 1.2}


def test_a_peak_of_speed_is_where_it_is():
    given = Given(stiffness=curve(
        speed=[0.2, 0.4, 0.1], step_length=[1.0, 1.0, 0.5], power=[1.0, 2.0, 4.0],
        cost_of_transport=[1.0, 2.0, 4.0],
    ))  # fmt: skip
    found = MEASURES["speed_peak"](given)
    assert found["peak_at"] == 550.0 and found["last_over_peak"] == pytest.approx(0.25)
    assert found["share_of_power"] == pytest.approx(1.0)


def test_complexity_is_ranked_per_robot():
    def at(variant, m, n, accuracy):
        test = {"accuracy": accuracy, "speed": accuracy, "stability": -accuracy}
        return case(variant, at={"M": m, "N": n}, test=test)

    grid = [(m, n) for m in (1, 2, 3) for n in (1, 2, 3)]
    soft = [at("compliant", m, n, m + 0.01 * n) for m, n in grid]
    stiff = [at("stiff", m, n, 5.0 - n) for m, n in grid]
    found = MEASURES["complexity_compliant"](Given(complexity=soft + stiff))
    assert found["rho_M"] > 0.9 and found["rho_range_of_height"] == pytest.approx(-1.0)
    assert MEASURES["complexity_stiff"](Given(complexity=soft + stiff))["rho_N"] < -0.9


def test_trials_without_a_clock_are_counted():
    def trial(variant, survived, fall="", slip=0.0):
        return case(variant, verdict={
            "survived": survived, "fall": fall, "slip": slip, "amplitude": 1.0, "nrmse": 0.1,
            "frequency": 1.6, "target_frequency": 1.7,
        })  # fmt: skip

    given = Given(("pse", "rse"), chapter8=[
        trial("pse", True), trial("rse", False, "roll"), trial("rse", False, slip=3.0),
    ])  # fmt: skip
    assert MEASURES["clock_keeps_the_gait"](given)["survived"] == 1.0
    assert MEASURES["no_clock_fails"](given) == {"failed": 1.0, "fell": 0.5}
    assert MEASURES["phase_drifts"](given)["rse_slip"] == 1.5


def test_falls_that_coincide_are_counted():
    fell = {"robot": [0, 1, 1, 0], "calibrated": [0, 1, 0, 0], "default": [1, 1, 0, 0]}
    cases = [
        case(variant, verdict={"fall": "x" if f else ""}) for variant, row in fell.items()
        for f in row
    ]  # fmt: skip
    found = MEASURES["falls_coincide"](Given(amplitudes=cases))
    assert found == {"agree": 0.75, "default_agrees": 0.5, "robot_falls": 0.5}


def test_the_operations_are_those_of_the_equation():
    found = MEASURES["operations"](Given())
    assert found == {"operations_50": 13300.0, "operations_80": 33280.0}


def test_an_entry_runs_on_its_engine_with_its_points():
    entry = Entry("map", "hyq_map", "mujoco", points=3)
    loaded = entry.load()
    assert len(list(loaded.cases())) == 9
    assert loaded.variants["open"].sim["engine"] == "mujoco"
