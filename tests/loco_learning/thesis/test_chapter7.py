# SPDX-License-Identifier: Apache-2.0
"""What measures of chapter 7 and section 9 say of runs whose answer is known."""

import numpy as np
import pytest

from loco_learning.study import study as studies
from loco_learning.study.figures import VERDICT
from loco_learning.thesis import chapter7
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
    assert found["5 good"] == 1.0 and found["6 stiff"] == 1.0
    assert found["1 collapsed"] == found["4 overdamped"] == 0.0


def test_half_a_region_is_a_share():
    def behaves(kp, kappa):
        return {"survived": kp < 300.0}

    found = MEASURES["regions"](Map(behaves))
    assert 0.0 < found["5 good"] < 1.0 and found["6 stiff"] == 0.0


def test_what_is_underdamped_falls_and_takes_power():
    def behaves(kp, kappa):
        if kappa <= 0.1:
            return {"survived": False, "positive_power": 200.0, "grf_max": 1500.0,
                    "stability": 0.2}  # fmt: skip
        return {"stability": 0.01 if kappa >= 3.0 else 0.05}

    found = MEASURES["damping"](Map(behaves))
    assert found == pytest.approx({
        "falls_underdamped": 1.0, "falls_good": 0.0, "power_ratio": 4.0, "impact_ratio": 3.0,
        "overdamped_shake_ratio": 0.05,
    })  # fmt: skip


def test_the_stiff_robot_is_told_beside_the_compliant_one():
    def run(variant, scale, fell=False):
        metrics = dict.fromkeys(("stability", "power", "speed", "grf_max"), scale)
        return case(variant, train={} if fell else metrics)

    runs = [run("compliant", 1.0), run("compliant", 3.0), run("stiff", 4.0), run("stiff", 9, True)]
    found = MEASURES["compliant_and_stiff"](Given(complexity=runs))
    assert set(found.values()) == {2.0}  # a run that did not reach the phase is left out


def test_an_exponential_cost_is_found():
    kp = np.linspace(100.0, 1000.0, 7)
    found = MEASURES["cost_rises"](Given(stiffness=curve(cost_of_transport=np.exp(kp / 500.0))))
    assert found["r2"] == pytest.approx(1.0)
    assert found["slope_per_1000"] == pytest.approx(2.0)


def test_no_line_goes_through_two_points():
    cost = [np.nan, 1.0, -1.0, 2.0]
    assert MEASURES["cost_rises"](Given(stiffness=curve(cost_of_transport=cost))) == {}


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


def test_the_open_loop_has_a_peak_of_its_own():
    """The closed loop is 1 everywhere, and is not looked at."""
    given = Given(stiffness=curve(opened={"speed": [0.1, 0.3, 0.4, 0.2]}))
    assert MEASURES["open_speed_peak"](given) == pytest.approx(
        {"peak_at": 700.0, "first_over_peak": 0.25, "last_over_peak": 0.5}
    )


def test_an_accuracy_is_steady_beside_what_changes():
    given = Given(stiffness=curve(
        accuracy=[20.0, 25.0, 20.0], grf_max=[400.0, 500.0, 800.0], stability=[0.1, 0.1, 0.05],
    ))  # fmt: skip
    assert MEASURES["accuracy_steady"](given) == pytest.approx(
        {"accuracy_spread": 1.25, "impact_ratio": 2.0, "shake_ratio": 0.5}
    )


GRID = [(m, n) for m in (1, 2, 3) for n in (1, 2, 3)]


def sized(variant, m, n, accuracy, **test):
    test = {"accuracy": accuracy, "speed": accuracy, "stability": -accuracy} | test
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
        return case(variant, train={"step_time": seconds}, test={"accuracy": accuracy})

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
        return case(variant, at={"M": m, "N": 50}, test={"nrmse": error, "stability": 2.0 * error})

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
        test = {} if fall else {"nrmse": nrmse, "roll_range": roll}
        return case(variant, verdict={"fall": fall}, test=test)

    runs = [
        run("real_like", 0.2, 0.3), run("real_like", 0.0, 0.0, "roll"), run("ideal", 0.1, 0.1),
        run("disturbed_real_like", 0.6, 0.1), run("disturbed", 0.2, 0.1),
    ]  # fmt: skip
    assert MEASURES["real_like"](Given(real_like=runs)) == pytest.approx(
        {"survived": 0.5, "nrmse": 0.2, "roll_ratio": 3.0, "disturbed_nrmse_ratio": 3.0}
    )
    nothing = [case(r.variant, verdict={"fall": "roll"}) for r in runs]
    assert np.isnan(MEASURES["real_like"](Given(real_like=nothing))["nrmse"])


@pytest.mark.parametrize("noise", [0.0, 120.0])
def test_a_filter_of_forces_is_judged_beside_ideal_ones(noise, monkeypatch):
    """A clean stride passes it a little late; noise makes raw forces too large, not filtered."""
    t = chapter7.TICK * np.arange(2000)
    ideal = 300.0 + 200.0 * np.sin(2.0 * np.pi * 1.7 * t)[:, None].repeat(4, 1)
    raw = ideal + np.random.default_rng(3).normal(0.0, noise, ideal.shape)
    monkeypatch.setattr(chapter7, "_forces", lambda name, effects: raw if effects else ideal)
    found = MEASURES["force_filter"](Given())
    assert found["phase_shift_strides"] < 0.1
    if noise:
        assert found["raw_amplitude_error"] > 0.5 > found["filtered_over_raw"]
    else:
        assert found["raw_amplitude_error"] == 0.0 and found["filtered_over_raw"] == np.inf
