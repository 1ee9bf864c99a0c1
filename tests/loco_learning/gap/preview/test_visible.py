# SPDX-License-Identifier: Apache-2.0
"""The smallest size that shows, of effects whose response is known."""

from __future__ import annotations

import math
from types import SimpleNamespace

import numpy as np
import pytest

from loco_control.exceptions import ParameterError
from loco_learning.gap.hypotheses.bundles import Batch
from loco_learning.gap.hypotheses.hypotheses import Hypothesis
from loco_learning.gap.preview import visible
from loco_sim.effects import EFFECTS
from loco_sim.effects.coordinates import Coordinate

SAMPLES, SHOWS = 100, 0.75
WAVE = np.sin(np.arange(SAMPLES))
WAVE /= np.sqrt(np.mean(WAVE**2))
PRIOR = EFFECTS["coulomb_friction"].identity.priors["torque"]


def strength(name: str = "torque", size: float = 1.0, most: float = 1e3) -> Coordinate:
    return Coordinate(name, size, (1.0,), 0.0, most, "N·m", strength=True)


def law(effect: str = "coulomb_friction", place: str = "knee", size: Coordinate | None = None):
    return Hypothesis(effect, place, (("joint", place),), (size or strength(),))


class Case:
    """Two channels, which respond to the sum of all sizes as functions of it say.

    Args:
        loud: Rms of each channel over the size, by effect and joint.
        bent: Response over size.
        broken: Joints that no robot can be built with an effect of.
    """

    def __init__(self, loud: dict, bent=lambda size: size, broken: tuple[str, ...] = ()):
        self.loud, self.bent, self.broken, self.asked = loud, bent, broken, []
        self.forward = SimpleNamespace(channels=("q knee", "q hip"))

    def channel_of(self) -> np.ndarray:
        return np.repeat([0, 1], SAMPLES)

    def vector(self, specs, coarse):
        assert coarse
        total = np.zeros(2 * SAMPLES)
        for spec in specs:
            self.asked.append(spec["torque"])
            if spec["joint"] in self.broken:
                raise ParameterError(f"no {spec['name']} in {spec['joint']}")
            per = np.array(self.loud[spec["name"], spec["joint"]])
            total += np.outer(per, WAVE).ravel() * self.bent(spec["torque"])
        return total


def tried(case: Case, *laws: Hypothesis, channels=None) -> list[visible.Visible]:
    bundle = Batch(laws, tuple(channels or [None] * len(laws)))
    trials = visible.try_bundle(case, bundle, SHOWS, case.vector((), coarse=True))
    return visible._summarise(case, trials)


@pytest.mark.parametrize("loud", [1e-3, 0.3, 1.0, 40.0, 2e4])
def test_the_size_that_shows_is_found_however_loud_it_is(loud):
    case = Case({("coulomb_friction", "knee"): (0.1 * loud, loud)})
    (one,) = tried(case, law())
    assert one.smallest == pytest.approx(SHOWS / loud, rel=1e-3)
    assert one.channel == ("q hip" if one.seen != visible.NO else "")
    assert len(case.asked) <= visible.TRIES


@pytest.mark.parametrize("power", [0.5, 2.0, 3.0])
def test_a_response_that_is_no_line_is_followed(power):
    case = Case({("coulomb_friction", "knee"): (50.0, 1.0)}, lambda size: size**power)
    (one,) = tried(case, law())
    wanted = (SHOWS / 50.0) ** (1.0 / power)
    assert 0.4 * wanted < one.smallest < 2.5 * wanted  # near by it counts as a line


@pytest.mark.parametrize("threshold", [0.4, 0.2, 0.02])
def test_a_threshold_is_enclosed_between_a_dead_and_a_loud_size(threshold):
    """Far too loud from some size on and nothing below."""
    case = Case({("coulomb_friction", "knee"): (100.0, 0.0)}, lambda size: float(size >= threshold))
    (one,) = tried(case, law())
    tried_sizes = [size for size in case.asked if size > 0.0]
    loud = min(size for size in tried_sizes if size >= threshold)
    dead = max(size for size in tried_sizes if size < threshold)
    assert one.smallest == pytest.approx(loud / visible.LINEAR)
    assert loud <= visible.LINEAR**2 * dead or len(tried_sizes) == visible.TRIES


@pytest.mark.parametrize("level", [0.0, 40.0])
def test_sizes_far_apart_with_the_same_response_end_the_tries(level):
    """An effect without influence, and one that has saturated."""
    case = Case({("coulomb_friction", "knee"): (level, 0.0)}, lambda size: float(size > 0.0))
    (one,) = tried(case, law())
    assert len(case.asked) == 2
    assert (one.seen == visible.NO) is (level == 0.0)


def test_what_does_nothing_has_no_size_that_shows():
    (one,) = tried(Case({("coulomb_friction", "knee"): (0.0, 0.0)}), law())
    assert (one.smallest, one.seen, one.channel, one.alike) == (math.inf, visible.NO, "", ())


def test_a_size_beyond_what_the_law_allows_is_none():
    case = Case({("coulomb_friction", "knee"): (0.01, 0.0)})
    (one,) = tried(case, law(size=strength(most=50.0)))
    assert one.smallest == math.inf
    (one,) = tried(case, law(size=strength(most=100.0)))
    assert one.smallest == pytest.approx(75.0)


@pytest.mark.parametrize(
    ("smallest", "seen"),
    [(0.5 * PRIOR.typical, visible.YES), (0.5 * (PRIOR.typical + PRIOR.high), visible.LARGE),
     (1.1 * PRIOR.high, visible.NO)],
)  # fmt: skip
def test_it_shows_if_what_robots_usually_have_does(smallest, seen):
    case = Case({("coulomb_friction", "knee"): (SHOWS / smallest, 0.0)})
    (one,) = tried(case, law(size=strength(size=PRIOR.typical)))
    assert (one.seen, one.typical, one.most) == (seen, PRIOR.typical, PRIOR.high)


def test_those_tried_together_are_told_apart_by_their_channels():
    loud = {("coulomb_friction", "knee"): (2.0, 0.0), ("coulomb_friction", "hip"): (0.0, 5.0)}
    masks = np.array([True, False]), np.array([False, True])
    knee, hip = tried(Case(loud), law(), law(place="hip"), channels=masks)
    assert knee.smallest == pytest.approx(SHOWS / 2.0) and knee.channel == "q knee"
    assert hip.smallest == pytest.approx(SHOWS / 5.0) and hip.channel == "q hip"


def test_one_that_no_robot_can_have_costs_the_others_nothing():
    loud = {("coulomb_friction", joint): (1.0, 0.0) for joint in ("knee", "hip")}
    knee, hip = tried(Case(loud, broken=("hip",)), law(), law(place="hip"))
    assert knee.failed == "" and knee.smallest == pytest.approx(SHOWS)
    assert hip.failed == "no coulomb_friction in hip" and hip.smallest == math.inf


def test_effects_that_do_the_same_are_told_whichever_way_round():
    loud = {("coulomb_friction", "knee"): (1.0, 0.0), ("armature", "knee"): (-3.0, 0.0),
            ("push", "knee"): (0.0, 1.0)}  # fmt: skip
    case = Case(loud)
    trials = [
        trial
        for name, _ in loud
        for trial in visible.try_bundle(
            case, Batch((law(name),), (None,)), SHOWS, case.vector((), coarse=True)
        )
    ]
    rubs, rotor, push = visible._summarise(case, trials)
    assert (rubs.alike, rotor.alike) == (("armature",), ("coulomb_friction",))
    assert push.alike == ()


def test_each_strength_of_a_law_is_tried_with_the_others_at_nothing():
    asked = []
    law_of_two = Hypothesis(
        "imu_tilt",
        "",
        (),
        (strength("roll"), strength("pitch"), Coordinate("speed", 2.0, (0.5,), 0.1, 9.0)),
    )

    class Both(Case):
        def vector(self, specs, coarse):
            asked.extend(specs)
            return np.repeat([s["roll"] + 2.0 * s["pitch"] for s in specs] or [0.0], 2 * SAMPLES)

    both = Both({})
    base = both.vector((), coarse=True)
    trials = visible.try_bundle(both, Batch((law_of_two,), (None,)), SHOWS, base)
    assert [t.smallest() for t in trials] == pytest.approx([SHOWS, 0.5 * SHOWS])
    assert all(min(spec["roll"], spec["pitch"]) == 0.0 and spec["speed"] == 1.0 for spec in asked)
