# SPDX-License-Identifier: Apache-2.0
"""What measures of chapter 7 and section 9 say of runs whose answer is known."""

import numpy as np
import pytest

from loco_learning.study import study as studies
from loco_learning.study.figures import VERDICT
from loco_learning.thesis import chapter7, evidence
from loco_learning.thesis.evidence import Evidence
from loco_learning.thesis.registry import MEASURES

from .made import Given, case, curve


class Map(Given):
    """The shipped map of impedances in few points, with runs that behave as a function says."""

    def __init__(self, behaves):
        super().__init__()
        self._study = studies.load("hyq_map").with_points(13)
        axes = {axis.name: axis.values for axis in self._study.axes}
        self._made = [
            self._run(kp, kd, behaves(kp, kd / np.sqrt(kp))) for kp in axes["kp"]
            for kd in axes["kd"]
        ]  # fmt: skip

    def _run(self, kp, kd, values):
        survived = values.pop("survived", True)
        verdict = dict.fromkeys(VERDICT, 0.0) | {"survived": survived, "failed": [], "end": 15.0}
        usual = {"speed_ratio": 1.0, "positive_power": 50.0, "grf_max": 500.0, "stability": 0.05}
        return case(
            "open", verdict=verdict, at={"kp": kp, "kd": kd},
            train=dict.fromkeys(self._study.metrics, 1.0) | usual | values,
        )  # fmt: skip

    def study(self, name):
        return self._study, self._made


def test_a_region_is_there_where_the_robot_behaves_as_its_rule_says():
    """Good everywhere: the region of good impedances holds, that of a collapse does not."""
    found = MEASURES["regions"](Map(lambda kp, kappa: {}))
    assert found["5 good"].all() and found["6 stiff"].all() and len(found["5 good"]) > 4
    assert not found["1 collapsed"].any() and not found["4 overdamped"].any()


def test_half_a_region_is_a_share():
    def behaves(kp, kappa):
        return {"survived": kp < 300.0}

    found = MEASURES["regions"](Map(behaves))
    assert 0.0 < found["5 good"].mean() < 1.0 and not found["6 stiff"].any()


def test_what_is_underdamped_falls_and_takes_power():
    def behaves(kp, kappa):
        if kappa <= 0.1:
            return {"survived": False, "positive_power": 200.0, "grf_max": 1500.0,
                    "stability": 0.2}  # fmt: skip
        return {"stability": 0.01 if kappa >= 3.0 else 0.05}

    found = MEASURES["damping"](Map(behaves))
    assert {name: set(np.round(values, 9)) for name, values in found.items()} == {
        "falls_underdamped": {1.0}, "falls_good": {0.0}, "power_ratio": {4.0},
        "impact_ratio": {3.0}, "overdamped_shake_ratio": {0.05},
    }  # fmt: skip


def open_runs(*speeds, **others):
    """Open-loop runs at 75, 400 and 1000 N·m/rad, one row of speeds for each seed."""
    return [
        case("open", seed, at={"kp": kp}, **{"open loop": {"speed": v, **others}})
        for seed, row in enumerate(speeds) for kp, v in zip((75.0, 400.0, 1000.0), row, strict=True)
    ]  # fmt: skip


def test_the_stiff_robot_is_told_beside_the_compliant_one():
    runs = open_runs([0.2, 0.3, 0.1], [0.2, 0.3, 0.4], stability=1.0, power=2.0, grf_max=3.0)
    found = MEASURES["compliant_and_stiff"](Given(open_loop=runs))
    assert found["speed_ratio"] == pytest.approx([0.5, 2.0])
    assert found["power_ratio"].tolist() == found["grf_max_ratio"].tolist() == [1.0, 1.0]


def test_an_exponential_cost_is_found_for_each_network():
    kp = np.linspace(100.0, 1000.0, 7)
    runs = curve(cost_of_transport=np.exp(kp / 500.0))
    runs += curve(seed=1, cost_of_transport=np.exp(kp / 250.0))
    found = MEASURES["cost_rises"](Given(stiffness=runs))
    assert found["r2"] == pytest.approx([1.0, 1.0])
    assert found["slope_per_1000"] == pytest.approx([2.0, 4.0])


def test_no_line_goes_through_two_points():
    cost = [np.nan, 1.0, -1.0, 2.0]
    found = MEASURES["cost_rises"](Given(stiffness=curve(cost_of_transport=cost)))
    assert found["r2"].size == found["slope_per_1000"].size == 0


def test_crossing_and_never_better_read_the_same_ratio():
    given = Given(stiffness=curve(cost_of_transport=[0.8, 1.0, 3.0], speed=[1.0, 1.2, 0.5]))
    found = MEASURES["crossing"](given)
    assert (found["ratio_softest"], found["ratio_stiffest"], found["least"]) == (0.8, 3.0, 0.8)
    found = MEASURES["never_better"](given)
    assert (found["least_cost_ratio"], found["speed_ratio"]) == (0.8, 1.2)


def test_a_peak_of_speed_is_where_it_is_for_each_network():
    usual = {"step_length": [1.0, 1.0, 0.5], "power": [1.0, 2.0, 4.0],
             "cost_of_transport": [1.0, 2.0, 4.0]}  # fmt: skip
    runs = curve(speed=[0.2, 0.4, 0.1], **usual) + curve(seed=1, speed=[0.4, 0.2, 0.1], **usual)
    found = MEASURES["speed_peak"](Given(stiffness=runs))
    assert found["peak_at"].tolist() == [550.0, 100.0]
    assert found["last_over_peak"] == pytest.approx([0.25, 0.25])
    assert found["step_last_over_peak"] == pytest.approx([0.5, 0.5])
    assert found["share_of_power"] == pytest.approx([1.0, 1.0])


def test_the_peak_of_the_open_loop_is_that_of_the_other_runs():
    found = MEASURES["open_speed_peak"](Given(open_loop=open_runs([1, 4, 2], [1, 2, 1])))
    assert found["first_over_peak"].tolist() == [0.25, 0.5]
    assert found["last_over_peak"].tolist() == [0.5, 0.5]
    assert found["peak_at"].tolist() == [400.0, 400.0]


def test_noise_on_a_flat_speed_has_no_peak():
    """Its highest value is above the ends, but not at the place of the other runs' highest one."""
    rows = 1.0 + 0.03 * np.random.default_rng(2).normal(size=(200, 3))
    found = MEASURES["open_speed_peak"](Given(open_loop=open_runs(*rows)))
    assert np.mean(rows[:, 0] / rows.max(axis=1)) < 0.98
    assert np.median(found["first_over_peak"]) == pytest.approx(1.0, abs=0.015)


def test_an_accuracy_is_steady_beside_what_changes():
    given = Given(stiffness=curve(
        accuracy_author=[20.0, 25.0, 20.0], grf_max=[400.0, 500.0, 800.0],
        stability=[0.1, 0.1, 0.05],
    ))  # fmt: skip
    assert MEASURES["accuracy_steady"](given) == pytest.approx(
        {"accuracy_spread": 1.25, "impact_ratio": 2.0, "shake_ratio": 0.5}
    )


GRID = [(m, n) for m in (1, 2, 3) for n in (1, 2, 3)]


def sized(variant, m, n, accuracy, **test):
    test = {"accuracy_author": accuracy, "speed": accuracy, "stability": -accuracy} | test
    return case(variant, at={"M": m, "N": n}, test=test)


def test_complexity_is_ranked_per_robot():
    soft = [sized("compliant", m, n, m + 0.01 * n) for m, n in GRID]
    stiff = [sized("stiff", m, n, 5.0 - n) for m, n in GRID]
    found = MEASURES["complexity_compliant"](Given(complexity=soft + stiff))
    assert found["rho_M"] > 0.9 and found["rho_range_of_height"] == pytest.approx(-1.0)
    assert MEASURES["complexity_stiff"](Given(complexity=soft + stiff))["rho_N"] < -0.9


def test_three_runs_have_no_rank():
    runs = [sized("compliant", m, 1, float(m)) for m in (1, 2, 3)]
    found = MEASURES["complexity_compliant"](Given(complexity=runs))
    assert all(np.isnan(value) for value in found.values())


def test_networks_that_are_too_slow_do_not_count():
    def run(variant, accuracy, seconds):
        return case(variant, train={"step_time": seconds}, test={"accuracy_author": accuracy})

    runs = [
        run("compliant", 30.0, 0.001), run("compliant", 99.0, 0.005), run("stiff", 10.0, 0.002),
    ]  # fmt: skip
    found = MEASURES["training_time"](Given(complexity=runs))
    assert found == pytest.approx(
        {"slowest_ms": 5.0, "compliant_accuracy": 30.0, "compliant_over_stiff": 3.0}
    )
    alone = MEASURES["training_time"](Given(complexity=runs[:2]))
    assert alone["compliant_over_stiff"] == np.inf


def test_the_operations_are_those_of_the_equation():
    found = MEASURES["operations"](Given())
    assert found == {"operations_50": 13300.0, "operations_80": 33280.0}


def test_trajectories_are_those_of_the_network_nearest_to_50():
    def run(variant, m, error):
        return case(
            variant, at={"M": m, "N": 50}, test={"nrmse_author": error, "stability": 2.0 * error}
        )

    runs = [
        run("compliant", 40, 0.1), run("stiff", 40, 0.4), run("compliant", 80, 9.0),
        run("stiff", 80, 9.0),
    ]  # fmt: skip
    found = MEASURES["trajectories"](Given(complexity=runs))
    assert found == pytest.approx({"nrmse_ratio": 4.0, "shake_ratio": 4.0})


@pytest.mark.parametrize(
    ("powers", "share"),
    [
        ({"compliant": [10.0, 10.0], "stiff": [100.0, 100.0]}, 1.0),
        ({"compliant": [10.0, 100.0], "stiff": [10.0, 100.0]}, 0.0),
    ],
)
def test_power_is_explained_by_stiffness_or_it_is_not(powers, share):
    runs = [
        case(variant, test={"stability": p, "grf_max": p, "positive_power": p})
        for variant, values in powers.items() for p in values
    ]  # fmt: skip
    found = MEASURES["impacts"](Given(complexity=runs))
    assert found["power_by_stiffness"] == pytest.approx(share)
    assert found["rho_shake_impact"] == pytest.approx(1.0)


def test_the_real_like_robot_is_told_beside_the_ideal_one():
    def run(variant, nrmse, roll, fall=""):
        test = {} if fall else {"nrmse_author": nrmse, "roll_range": roll}
        return case(variant, verdict={"fall": fall}, test=test)

    runs = [
        run("real_like", 0.2, 0.3), run("real_like", 0.0, 0.0, "roll"), run("ideal", 0.1, 0.1),
        run("disturbed_real_like", 0.6, 0.1), run("disturbed", 0.2, 0.1),
    ]  # fmt: skip
    found = MEASURES["real_like"](Given(real_like=runs))
    assert found["survived"].tolist() == [1.0, 0.0]
    assert found["nrmse"][0] == 0.2 and np.isnan(found["nrmse"][1])
    assert found["roll_ratio"] == pytest.approx([3.0])
    assert found["disturbed_nrmse_ratio"] == pytest.approx([3.0])
    nothing = [case(r.variant, verdict={"fall": "roll"}) for r in runs]
    assert np.isnan(MEASURES["real_like"](Given(real_like=nothing))["nrmse"]).all()


@pytest.mark.parametrize("noise", [0.0, 120.0])
def test_a_filter_of_forces_is_judged_beside_ideal_ones(noise, monkeypatch):
    """A clean stride passes it a little late; noise makes raw forces too large, not filtered."""
    t = chapter7.TICK * np.arange(2000)
    ideal = 300.0 + 200.0 * np.sin(2.0 * np.pi * 1.7 * t)[:, None].repeat(4, 1)
    raw = ideal + np.random.default_rng(3).normal(0.0, noise, ideal.shape)
    monkeypatch.setattr(chapter7, "_forces", lambda run, seed: raw if run.effects else ideal)
    found = MEASURES["force_filter"](Evidence(evidence.plan("quick"), None))
    assert len(found["phase_shift_strides"]) == 5 and found["phase_shift_strides"].max() < 0.1
    if noise:
        assert found["raw_amplitude_error"].min() > 0.5 > found["filtered_over_raw"].max()
    else:
        assert not found["raw_amplitude_error"].any()
        assert np.isinf(found["filtered_over_raw"]).all()
