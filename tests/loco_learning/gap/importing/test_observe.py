# SPDX-License-Identifier: Apache-2.0
"""Quantisation steps and saturation of raw signals."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from loco_learning.gap.importing import observe
from loco_learning.gap.recordings import lags
from loco_learning.gap.recordings.tracks import Track

T = np.arange(2000) * 0.005


def track(x, role="dq") -> Track:
    return Track(role, "hinge", T, np.asarray(x), "made")


@pytest.mark.parametrize("step", [0.00506, 0.1, 2 * np.pi / 4096])
@pytest.mark.parametrize("offset", [0.0, 0.037])
def test_the_step_is_found(step, offset):
    x = step * np.round(np.sin(3.0 * T) * np.exp(0.1 * T) / step) + offset
    assert observe.steps([track(x)])["dq", "hinge"] == pytest.approx(step, rel=1e-6)


def test_smooth_signals_have_no_step():
    noise = np.random.default_rng(0).normal(size=len(T))
    for x in (np.sin(T), np.sin(T) + 1e-3 * noise, noise, np.sin(T).round(9)):
        assert observe.steps([track(x)])["dq", "hinge"] == 0.0


def test_what_does_not_move_says_nothing_of_its_step():
    assert observe.steps([track(0.0 * T)]) == {}


def test_even_stamps_do_not_jitter():
    assert observe.stamps([track(T)])["dq"]["jitter_ms"] == 0.0


def test_a_first_row_of_zeros_is_no_reading_and_other_first_readings_are_told():
    def of(first, others=0.0):
        made = []
        for i in range(2):
            x = 0.3 + 0.2 * np.sin((3.0 + i) * T)
            x[0] = x[0] if first is None else first + others * i
            made.append(Track("q", f"joint{i}", T, x, "made"))
        return [*made, Track("command_position", "joint0", T, np.sin(T), "made")]

    for first, others, rows, words in (
        (None, 0.0, 2000, ""), (0.0, 0.0, 1999, "is 0, far from the others: left out"),
        (0.5, 0.0, 2000, "joint0 by 0.197, q of joint1 by 0.196"), (0.0, 0.31, 2000, "q of joint0"),
    ):  # fmt: skip
        notes = []
        tracks = observe.without_placeholder(of(first, others), notes)
        assert [len(k.t) for k in tracks] == [rows, rows, 2000]
        assert len(notes) == bool(words) and all(words in note for note in notes)
    single, notes = of(0.0)[:1], []
    assert observe.without_placeholder(single, notes) == single and "rows: [1, null]" in notes[0]
    flicker = track(np.where(T == 0.0, 1e-4, 0.0), "q")  # of a joint that stays
    assert observe.without_placeholder([flicker, *of(None)], notes) and len(notes) == 1


def test_cut_off_signals_are_told():
    wave = np.sin(3.0 * T) + 0.01 * np.random.default_rng(0).normal(size=len(T))
    notes = observe.notes([track(wave.clip(-0.8, 2.0), "tau")], 200.0, 4.5)
    assert len(notes) == 1 and "tau of hinge is at its smallest value -0.8 for" in notes[0]
    assert observe.notes([track(wave, "tau")], 200.0, 4.5) == []


@pytest.mark.parametrize(("size", "told"), [(3.0, False), (10.4, False), (13.0, True)])
def test_torques_that_the_model_cannot_give_are_told(size, told):
    plant = SimpleNamespace(joints=("hinge",), effort=np.array([10.0]), drives={"hinge": None},
                            springs={})  # fmt: skip
    notes = observe.above_limits([track(size * np.sin(3.0 * T), "tau"), track(99.0 * T)], plant)
    assert bool(notes) is told and all("effort limit of the model is 10" in note for note in notes)
    plant.springs = {"hinge": None}  # which may be in the torque
    assert observe.above_limits([track(size * np.sin(3.0 * T), "tau")], plant) == []


@pytest.mark.parametrize("shift", [0.0, 0.0113, 0.05])
def test_lags_are_continuous(shift):
    rng = np.random.default_rng(0)
    pitch, phase = rng.uniform(2.0, 40.0, 20), rng.uniform(0.0, 6.0, 20)

    def wave(t):
        return np.sum(np.sin(np.outer(t, pitch) + phase), axis=1)

    found, alike = lags.lag(wave(T), wave(T - shift), 0.005)
    assert found == pytest.approx(shift, abs=5e-4)
    assert shift == 0.0 or alike > 0.95


def test_strangers_have_no_lag():
    rng = np.random.default_rng(0)
    _, alike = lags.lag(rng.normal(size=2000), rng.normal(size=2000), 0.005)
    assert alike < 0.2
    assert lags.lag(np.zeros(2000), np.ones(2000), 0.005) == (0.0, 0.0)


URDF = """<robot name="r"><link name="a"/><link name="b"/><joint name="hinge" type="{}">
<parent link="a"/><child link="b"/></joint></robot>"""


def folded(turns=1.6, role="q") -> tuple[Track, np.ndarray]:
    """An angle that was folded into one turn, and the one before."""
    whole = 2.0 * np.pi * turns * np.sin(1.0 * T)
    return track((whole + np.pi) % (2.0 * np.pi) - np.pi, role), whole


def plant(kind="continuous") -> SimpleNamespace:
    return SimpleNamespace(urdf=URDF.format(kind))


@pytest.mark.parametrize("role", ["q", "command_position"])
def test_an_angle_that_was_folded_is_whole_again_and_told(role):
    told = []
    wrapped, whole = folded(turns=0.52 if role == "command_position" else 1.6, role=role)
    jumps = int(np.sum(np.abs(np.diff(wrapped.x)) > np.pi))
    found = observe.unwrapped(wrapped, plant(), told)
    assert found.x == pytest.approx(whole)
    assert jumps > 0 and told == [
        f"{wrapped.label} was wrapped: {jumps} jumps of a turn were undone"
    ]


@pytest.mark.parametrize(
    ("role", "kind", "change"),
    [
        ("dq", "continuous", lambda x: x),  # no angle
        ("q", "prismatic", lambda x: x),  # no turn
        ("q", "continuous", lambda x: 0.3 * x),  # no jump of a turn
        ("q", "continuous", lambda x: np.where(T > 5.0, x + 3.0, x)),  # nor these alone
        ("command_position", "continuous", lambda x: 1.2 * x),  # a command may step by a turn
        ("q", "continuous", lambda x: x[:1]),
    ],
)
def test_what_is_no_folded_angle_stays(role, kind, change):
    told = []
    wrapped = folded(role=role)[0]
    odd = replace(wrapped, x=change(wrapped.x))
    assert observe.unwrapped(odd, plant(kind), told) is odd and told == []
