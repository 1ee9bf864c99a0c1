# SPDX-License-Identifier: Apache-2.0
"""Effects that a linear step does not find: limits that are not reached, friction that stops."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from loco_control.exceptions import ParameterError
from loco_learning.gap.fitting.screen import NEGLIGIBLE, RUNGS, TRIES, _quiet
from loco_learning.gap.fitting.screen import screen as screened
from loco_learning.gap.hypotheses import hints
from loco_learning.gap.hypotheses.bundles import Batch
from loco_learning.gap.hypotheses.hypotheses import offer
from loco_sim.effects.offers import Motion
from loco_sim.robot import robot

from .. import laws

LATE = {"name": "command_delay", "delay": 0.02}


def tried(bench, effect, name):
    """What an effect of some name explains of what an effect makes."""
    case, offered = bench([effect])
    case = case.kept()
    residual = case.vector([], {}, case.fitted, coarse=True)
    (found,) = screened(case, offered[name], [], {}, case.fitted, residual)
    return found


@pytest.mark.parametrize(
    "effect",
    [
        {"name": "torque_limit", "reduction": 0.8},
        {"name": "stribeck_friction", "torque": 4.3, "velocity": 0.085},
        {"name": "coulomb_friction", "torque": 3.0},
        LATE,
    ],
)
def test_what_is_missing_is_found_at_any_size(bench, effect):
    found = tried(bench, effect, effect["name"])
    assert found.share > NEGLIGIBLE
    assert not found.dead


def test_the_longest_legal_delay_can_be_simulated(bench):
    case, _ = bench([LATE])
    assert len(case.vector([{"name": "command_delay", "delay": 1.0}])) > 0


def test_what_cannot_explain_anything_does_not(bench):
    found = tried(bench, {"name": "torque_limit", "reduction": 0.8}, "command_delay")
    assert found.share < NEGLIGIBLE


def alone(effect, does, size, elsewhere=0.0, forward=None):
    """What an effect of one strength explains, if a size does so much of a wave.

    A gap `elsewhere`, times the wave, is in a second branch that the effect does not touch. With
    `forward`, limits are sized by the torques of its drives.
    """
    wave = np.sin(np.arange(200.0))

    def vector(specs, overrides, only, coarse):
        here = wave * (does(sum(next(iter(strengths(s)), 0.0) for s in specs)) - does(size))
        return np.concatenate([here, elsewhere * wave]) if elsewhere else here

    def strengths(spec):
        return (spec[c.name] for c in hypothesis.coordinates if c.name in spec)

    channels = np.repeat([0, 1], 200) if elsewhere else np.zeros(200, int)
    mask = np.array([True, False]) if elsewhere else None
    case = SimpleNamespace(vector=vector, channel_of=lambda only: channels, rounds=True)
    plant = forward.robot() if forward else robot.load("servo_pendulum")
    offered = offer(plant, ("q",), Motion(np.full(1, -0.5), np.full(1, 0.5)))
    offered = hints.sized(offered, forward) if forward else offered
    (hypothesis,) = [h for h in offered if h.effect == effect]
    (found,) = screened(case, Batch((hypothesis,), (mask,)), [], {}, [0], vector([], {}, [0], 1))
    return found, next(strengths(hypothesis.term(found.x).params))


def test_a_size_that_is_far_too_loud_and_turns_round_does_not_end_the_search():
    """A drive that rounds its encoder does at a fifth of sag the contrary of at a fortieth."""
    found, sag = alone("supply_sag", lambda sag: sag if sag < 0.1 else -sag, 0.025)
    assert found.share > 0.9
    assert sag == pytest.approx(0.025, rel=0.3)


def test_a_limit_that_is_reached_late_is_found_between_nothing_and_all_there_is():
    """At 60 % a limit does nothing, at 100 % the robot falls: linear steps went in circles."""
    found, missing = alone("torque_limit", lambda x: max(x - 0.75, 0.0) ** 2, 0.8)
    assert found.share > 0.5
    assert missing == pytest.approx(0.8, abs=0.02)


@pytest.mark.parametrize("elsewhere", [4.0, 40.0, 200.0, 390.0])
def test_a_gap_elsewhere_does_not_change_the_size_of_a_limit(elsewhere):
    """On a HyQ with a payload at another leg a limit of 0.84 was sought beyond 0.86."""

    def does(x):
        return 1e5 * max(x - 0.78, 0.0) ** 2

    found, missing = alone("torque_limit", does, 0.8, elsewhere)
    assert missing == pytest.approx(alone("torque_limit", does, 0.8)[1])
    assert missing == pytest.approx(0.8, abs=0.01)
    assert found.share * (1.0 + elsewhere**2 / does(0.8) ** 2) > NEGLIGIBLE


def test_what_is_nothing_at_one_size_and_too_much_at_the_next_is_found_between():
    """On 12 joints a torque-speed line of 0.1 s/rad limits nothing at 0.09, and all at 0.12."""
    found, slope = alone("torque_speed_line", lambda x: max(x - 0.09, 0.0) ** 2, 0.104)
    assert found.share > 0.3
    assert slope == pytest.approx(0.104, rel=0.1)


def test_a_limit_that_does_as_much_elsewhere_a_little_further_is_found_below():
    """On an arm 0.145 s/rad limits as much as 0.141 does, three hundredths of a second too long."""

    def line(x):
        return 12.0 * max(x - 0.13, 0.0) * (1.0 if x < 0.143 else -1.0)

    found, slope = alone("torque_speed_line", line, 0.1414)
    assert found.share > 0.3
    assert slope == pytest.approx(0.1414, rel=0.05)


def test_a_size_that_does_nothing_of_its_own_is_not_made_smaller_for_ever():
    """A drive with backlash of no width still has its rotor: what is left does not get less."""
    found, _ = alone("backlash", lambda x: {0.0: 0.0, 1e-3: 1.0}.get(x, -1.2), 1e-3)
    assert found.share < NEGLIGIBLE
    assert found.cost <= 12  # three starts of the rotor


@pytest.mark.parametrize(
    ("level", "elsewhere", "quiet"), [(1.0, 10.0, True), (1.3, 30.0, False), (1.05, 1.2, False)]
)
def test_a_branch_is_quiet_beside_its_noise_and_beside_the_whole_gap(level, elsewhere, quiet):
    """A joint of an arm that rubs shows little beside others, and much beside its noise."""
    rows = np.arange(1000) < 400
    assert _quiet(np.where(rows, level, elsewhere), rows) == quiet


def test_a_branch_that_is_quiet_is_not_tried_and_explains_nothing():
    rows = np.repeat([True, False], 500)
    residual = np.where(rows, 1.0, 50.0)
    case = SimpleNamespace(vector=None, channel_of=lambda only: np.where(rows, 0, 1))
    bundle = Batch((laws.COULOMB,), (np.array([True, False]),), passes=True)
    (found,) = screened(case, bundle, [], {}, [0], residual)
    assert (found.share, found.cost, found.dead) == (0.0, 0, False)


def test_what_cannot_be_built_explains_nothing_and_does_not_keep_others_from_it():
    t = np.linspace(0.0, 20.0, 200)
    late = laws.hypothesis("command_delay", laws.DELAY, place="hip")

    def vector(specs, overrides, only, coarse):
        if any("delay" in spec for spec in specs):
            raise ParameterError("no such delay")
        return (sum(spec["torque"] for spec in specs) - 0.07) * np.sin(t)

    case = SimpleNamespace(vector=vector, channel_of=lambda only: np.zeros(200, int))
    bundle = Batch((laws.COULOMB, late), (None, None))
    rubs, failed = screened(case, bundle, [], {}, [0], vector([], {}, [0], True))
    assert rubs.share == pytest.approx(1.0) and not rubs.failed
    assert (failed.share, failed.dead, failed.failed) == (0.0, True, "no such delay")


@pytest.mark.parametrize("level", [0.01, 0.3, 1.5])
@pytest.mark.parametrize("above", [0.0, 1e3, np.inf])
def test_what_does_the_same_at_every_size_is_left_after_a_few(level, above):
    """Friction that holds a joint, or nothing up to some size: it has no end."""
    t, count = np.linspace(0.0, 20.0, 400), 0

    def vector(specs, overrides, only, coarse):
        nonlocal count
        count += 1
        assert count < 50
        acts = sum(abs(spec["torque"]) > above * laws.TORQUE.size for spec in specs)
        return np.sin(t) + level * acts * np.cos(t)

    case = SimpleNamespace(vector=vector, channel_of=lambda only: np.zeros(400, int), rounds=True)
    law = laws.hypothesis("coulomb_friction", replace(laws.TORQUE, high=1e12))
    (found,) = screened(case, Batch((law,), (None,)), [], {}, [0], np.sin(t))
    assert found.share < NEGLIGIBLE and found.cost <= TRIES + RUNGS + 1


@pytest.mark.parametrize(("count", "share"), [(1, 1.0), (2, 0.9), (3, 0.9)])
def test_what_several_strengths_explain_is_promised_less_a_tenth(count, share):
    """One is simulated at its size; of several, only one at a time was."""
    t = np.linspace(0.0, 20.0, 400)
    waves = [np.sin((1.0 + k) * t) for k in range(count)]
    sizes = [replace(laws.TORQUE, name=f"torque_{k}") for k in range(count)]

    def vector(specs, overrides, only, coarse):
        (spec,) = specs
        return sum((spec[c.name] - 0.07) * w for c, w in zip(sizes, waves, strict=True))

    case = SimpleNamespace(vector=vector, channel_of=lambda only: np.zeros(400, int))
    law = laws.hypothesis("coulomb_friction", *sizes)
    gap = vector([dict.fromkeys([c.name for c in sizes], 0.0)], {}, [0], True)
    (found,) = screened(case, Batch((law,), (None,)), [], {}, [0], gap)
    assert found.share == pytest.approx(share, abs=1e-6)
    assert found.x == pytest.approx([0.07 / 0.05] * count, rel=0.01)


@pytest.mark.parametrize("depth", [0.03, 0.07, 0.3])
@pytest.mark.parametrize("unused", [1.2, 7.0, 100.0])
@pytest.mark.parametrize("effect", ["torque_limit", "torque_speed_line"])
def test_a_limit_is_found_however_little_of_the_legal_torque_was_asked_for(effect, unused, depth):
    """Of 6 N·m a pendulum was asked for 0.84: dead at a limit of 0.84, found at 0.78."""
    t = np.linspace(0.0, 20.0, 400)
    torque, speed = np.sin(t)[:, None], 2.0 * np.sin(t + 0.7)[:, None]
    plant = replace(robot.load("pendulum"), effort=np.array([unused]))
    reached = hints.SMALLEST[effect]
    driving = np.maximum(speed * np.sign(torque), 0.0)
    size = reached((1.0 - depth) * np.abs(torque) / unused, driving)

    def does(x):
        over = np.abs(torque) - unused * (1.0 - x * (driving if "line" in effect else 1.0))
        return float(np.maximum(over * (driving > 0.0), 0.0).mean())

    forward = SimpleNamespace(robot=lambda: plant, drives=lambda: (torque, speed))
    found, value = alone(effect, does, size, forward=forward)
    assert found.share > 0.3
    assert 0.3 < does(value) / does(size) < 3.0


def quiet_beside(effect, level, rounds=False):
    """Screening of an effect whose response, at its first size, is `level` times the residual.

    The response is at right angles to the residual, so that no size of it explains anything.
    """
    wave, other = np.sin(np.arange(200.0)), np.cos(np.arange(200.0))
    offered = offer(robot.load("servo_pendulum"), ("q",), Motion(np.full(1, -0.5), np.full(1, 0.5)))
    hypothesis = next(h for h in offered if h.effect == effect and len(h.strengths) == 1)
    ((at,), sizes) = hypothesis.strengths, []
    key, first = hypothesis.coordinates[at].name, None

    def vector(specs, overrides, only, coarse):
        nonlocal first
        size = specs[0][key] if specs else 0.0
        sizes.append(size)
        first = first or size
        return wave + (level * size / first * other if specs else 0.0)

    flat = np.zeros(200, int)
    case = SimpleNamespace(vector=vector, channel_of=lambda only: flat, rounds=rounds)
    (found,) = screened(case, Batch((hypothesis,), (None,)), [], {}, [0], wave)
    return found, len(hypothesis.starts())


@pytest.mark.parametrize("level", [0.01, 0.3, 2.0, 50.0, 1000.0])
@pytest.mark.parametrize("effect", ["viscous_friction", "joint_offset", "torque_constant_error"])
def test_a_smooth_effect_that_promises_nothing_costs_two_simulations_a_start(effect, level):
    found, starts = quiet_beside(effect, level)
    assert found.share < NEGLIGIBLE and not found.dead
    assert found.cost <= 2 * starts


@pytest.mark.parametrize(("effect", "rounds"), [("torque_limit", False), ("joint_offset", True)])
def test_what_acts_in_jumps_is_tried_further(effect, rounds):
    """A limit, and whatever a drive that rounds its encoder is moved by."""
    found, starts = quiet_beside(effect, 0.3, rounds)
    assert found.cost > 2 * starts
