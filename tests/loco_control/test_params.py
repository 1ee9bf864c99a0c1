# SPDX-License-Identifier: Apache-2.0
"""Parameters: type, range, unknown keys, and every class of this package."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import numpy as np
import pytest

from loco_control.exceptions import NameUnknownError, ParameterError
from loco_control.gait.generator import GaitParams
from loco_control.gait.oscillators import CpgParams
from loco_control.legs.geometry import LegGeometry
from loco_control.params import Params, from_dict, limits, parameter, to_dict
from loco_control.stance.controller import StanceParams
from loco_control.stance.mpc import MpcParams
from loco_control.stance.trunk import TrunkParams


@dataclass(frozen=True)
class Inner(Params):
    """Numbers."""

    gain: float = parameter(1.0, "a gain", "N/m", low=0.0, high=10.0)
    count: int = parameter(3, "a count", low=1)


@dataclass(frozen=True)
class Outer(Params):
    """The other kinds."""

    name: str = parameter("a", "a name", choices=("a", "b"))
    on: bool = parameter(False, "a switch")
    pair: tuple[float, float] = parameter((1.0, 2.0), "two numbers", "m", low=-5.0)
    inner: Inner = parameter(Inner(), "nested")
    anything: object = parameter(None, "not checked")


ALL = [Inner, Outer, CpgParams, GaitParams, LegGeometry, MpcParams, StanceParams, TrunkParams]


@pytest.mark.parametrize("cls", ALL)
def test_defaults_are_legal_and_survive_a_round_trip(cls):
    assert from_dict(cls, to_dict(cls())) == cls() == from_dict(cls, None)


@pytest.mark.parametrize("cls", ALL)
def test_every_parameter_says_what_it_is(cls):
    for f in dataclasses.fields(cls):
        assert f.metadata["doc"] and f.metadata["unit"], f.name


@pytest.mark.parametrize("cls", ALL)
def test_every_bound_is_enforced(cls):
    for f in dataclasses.fields(cls):
        default = f.default
        many = isinstance(default, tuple)
        for limit, beyond in ((f.metadata["low"], -1), (f.metadata["high"], 1)):
            if limit is not None:
                value = (limit + beyond,) * len(default) if many else limit + beyond
                with pytest.raises(ParameterError, match=f.name):
                    cls(**{f.name: value})
                assert from_dict(cls, {f.name: (limit,) * len(default) if many else limit})


@pytest.mark.parametrize(
    ("values", "error", "text"),
    [
        ({"nmae": "a"}, NameUnknownError, "in Outer .*did you mean 'name'"),
        ({"inner": {"gian": 1.0}}, NameUnknownError, r"in inner .*did you mean 'gain'"),
        ({"inner": {"gain": 11.0}}, ParameterError, r"inner.gain must be in \[0, 10\] N/m, got 11"),
        ({"inner": 3}, ParameterError, "inner must be a mapping, got 3"),
        ({"inner": {"gain": "hard"}}, ParameterError, r"a number \[N/m\], got 'hard'"),
        ({"inner": {"gain": True}}, ParameterError, "must be a number"),
        ({"inner": {"gain": float("nan")}}, ParameterError, "got nan"),
        ({"inner": {"count": 2.5}}, ParameterError, "whole number"),
        ({"name": "c"}, NameUnknownError, "available: a, b"),
        ({"name": 1}, ParameterError, "must be text"),
        ({"on": "yes"}, ParameterError, "true or false"),
        ({"on": 1}, ParameterError, "true or false"),
        ({"pair": [1.0]}, ParameterError, "must have 2 values, got 1"),
        ({"pair": 1.0}, ParameterError, "list of 2 numbers"),
        ({"pair": "ab"}, ParameterError, "list of 2 numbers"),
        ({"pair": [1.0, -6.0]}, ParameterError, r"pair\[1\] must be in \[-5, inf\] m"),
    ],
)
def test_a_wrong_value_gets_one_clear_message(values, error, text):
    with pytest.raises(error, match=text):
        from_dict(Outer, values)


def test_values_take_the_type_of_their_default():
    made = from_dict(Outer, {"pair": [3, np.float64(4.0)], "inner": {"gain": 2, "count": 4.0}})
    assert made.pair == (3.0, 4.0) and isinstance(made.pair[0], float)
    assert isinstance(made.inner.gain, float) and isinstance(made.inner.count, int)


def test_replace_checks_again_and_leaves_the_original():
    params = Inner()
    assert params.replace(gain=2.0).gain == 2.0 and params.gain == 1.0
    with pytest.raises(ParameterError):
        params.replace(gain=-1.0)


def test_parameters_are_frozen():
    with pytest.raises(dataclasses.FrozenInstanceError):
        Inner().gain = 2.0


def test_plain_values_hold_no_tuples():
    assert to_dict(Outer())["pair"] == [1.0, 2.0]
    assert to_dict(Outer())["inner"] == {"gain": 1.0, "count": 3}


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"count": float("nan")}, "got nan"),
        ({"count": float("inf")}, "finite"),
        ({"gain": np.zeros(2)}, "must be a number"),
        ({"gain": float("inf")}, r"\[0, 10\] N/m"),
    ],
)
def test_numbers_that_are_none_are_refused_with_a_clear_message(values, message):
    with pytest.raises(ParameterError, match=message):
        from_dict(Inner, values)


@pytest.mark.parametrize(
    ("name", "wanted"),
    [("gain", (0.0, 10.0)), ("count", (1, np.inf)), ("other", (-np.inf, np.inf))],
)
def test_limits_are_those_of_the_field_or_none(name, wanted):
    @dataclass(frozen=True)
    class More(Inner):
        other: float = parameter(0.0, "anything")

    assert limits(More, name) == wanted
