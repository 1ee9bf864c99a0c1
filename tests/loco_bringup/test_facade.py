# SPDX-License-Identifier: Apache-2.0
"""Whatever a caller of `import loco` gets wrong is one error that names the argument."""

from __future__ import annotations

import inspect
from pathlib import Path

import numpy as np
import pytest

import loco
from loco_bringup.report import report as reports
from loco_learning.runs import rollout as rollouts
from loco_learning.runs.experiment import load


class Unprintable:
    def __repr__(self):
        raise RuntimeError("no text")


PLACES = {
    "empty": "", "missing": "nowhere/to_be_seen", "long": "x" * 5000, "null byte": "a\0b",
    "path": Path("/nonexistent/x"), "root": Path("/"), "device": "/dev/null",
}  # fmt: skip
NUMBERS = {
    "nan": float("nan"), "infinity": float("inf"), "negative": -1, "zero": 0, "true": True,
    "fraction": 3.5, "huge": 10**30, "5000 digits": 10**5000,
}  # fmt: skip
OTHERS = {
    "none": None, "bytes": b"a", "list": [], "list of none": [None], "mapping": {}, "keys": {1: 2},
    "object": object(), "unprintable": Unprintable(), "function": lambda: None, "class": int,
    "array": np.zeros(3),
}  # fmt: skip
ODD = {**PLACES, **NUMBERS, **OTHERS}
# Right arguments: of a recording that does not fit the robot, so that no search begins.
RIGHT = {
    "load_bag": {"path": "nowhere"},
    "robot": {"name_or_path": "servo_pendulum"},
    "rollout": {"experiment": "surrogate_sine", "overrides": {"duration": 0.02}, "seed": 1},
    "find_gap": {"recordings": ["nowhere"], "robot": "servo_pendulum"},
    "export_model": {"model": "nowhere", "to": "urdf"},
    "report": {"bag": "nowhere"},
}
OPTIONS = ("seed", "effects", "window", "free", "no_option_of_this_name")


def arguments(function):
    for name, parameter in inspect.signature(function).parameters.items():
        yield from OPTIONS if parameter.kind is parameter.VAR_KEYWORD else (name,)


def test_every_function_is_tried():
    functions = [n for n in loco.__all__ if inspect.isfunction(getattr(loco, n))]
    assert sorted(RIGHT) == sorted(functions)


@pytest.mark.parametrize("name", RIGHT)
def test_odd_arguments_are_errors_of_loco_that_name_them(name, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(rollouts, "rollout", lambda *given: None)
    function, tried = getattr(loco, name), 0
    for argument in arguments(function):
        for kind, value in ODD.items():
            try:
                function(**{**RIGHT[name], argument: value})
            except loco.LocoError as error:
                tried += 1
                text = str(error)
                assert len(text) < 1000 and "\n" not in text, text
                if kind in OTHERS and "nowhere" not in text and argument not in OPTIONS:
                    assert argument in text, (argument, kind, text)
    assert tried > 20
    assert not [p for p in tmp_path.iterdir() if p.name not in ("a", "results")]


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: loco.robot(), "robot: missing a required argument: 'name_or_path'"),
        (lambda: loco.report("a", gif=1), "gif must be true or false, got 1"),
        (lambda: loco.report("a", page=1), "report: got an unexpected keyword argument 'page'"),
        (lambda: loco.find_gap([], "servo_pendulum"), "recordings must be one or more"),
        (lambda: loco.find_gap(["a", 3], "servo_pendulum"), r"recordings\[1\] must be a text or a"),
        (lambda: loco.find_gap("a", "b", hold_out="c"), "hold_out must be a list"),
        (lambda: loco.find_gap("a", "b", workers=0), r"workers must be in \[1, 1024\], got 0"),
        (lambda: loco.find_gap("a", "b", on_progress=len), "on_progress must be a function of 3"),
        (lambda: loco.rollout("hyq_short", seed=-1), r"seed must be in \[0"),
        (lambda: loco.rollout("hyq_short", {3: 1}), "a key of overrides must be a text, got 3"),
        (lambda: loco.rollout(load("hyq_short"), {"seed": 1}), "overrides must be left out"),
    ],
)
def test_what_is_wanted_is_said(call, words):
    with pytest.raises(loco.LocoError, match=words):
        call()


def test_errors_of_a_callback_are_the_callers_own():
    def stop(t):
        raise KeyError("mine")

    with pytest.raises(KeyError, match="mine"):
        loco.rollout("surrogate_sine", {"duration": 0.1}, on_progress=stop)


def test_right_arguments_reach_the_work(monkeypatch, tmp_path):
    asked = []
    monkeypatch.setattr(reports, "write_report", lambda *a: asked.append(a) or tmp_path / "r.html")
    assert loco.report(Path("a"), "b.html", gif=False).path == tmp_path / "r.html"
    assert asked == [(Path("a"), "b.html", False)]
