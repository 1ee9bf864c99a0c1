# SPDX-License-Identifier: Apache-2.0
"""Effects of a fleet: their sizes are ratios, and laws of one kind at one place are one effect."""

import itertools

import numpy as np
import pytest

from loco_learning.gap.fleet.terms import at_ratio, terms_of, union

COULOMB = {"name": "coulomb_friction", "joint": "knee", "torque": 2.0}
STRIBECK = {"name": "stribeck_friction", "joint": "knee", "torque": 2.0, "velocity": 0.1}
PAYLOAD = {"name": "payload", "link": "hand", "mass": 0.3, "position": [0.0, 0.0, 0.1]}
CENTRE = {"name": "com_offset", "link": "hand", "offset": [0.03, 0.0, -0.04]}
BIAS = {"name": "sensor_bias", "joint": "knee", "q": -0.01}


def found(*specs, verdict="named", probability=0.99):
    """Effects of a search."""
    effects = [{"name": "armature", "joint": "knee", "inertia": 0.1}, *specs]
    names = {spec["name"]: probability for spec in specs}
    result = {"verdict": verdict, "model": {"effects": effects}, "probability": {"effects": names}}
    return terms_of(result, 1)


def test_a_size_is_its_strength_and_scales_alone():
    sizes = {"coulomb_friction": 2.0, "payload": 0.3, "com_offset": 0.05, "sensor_bias": -0.01}
    for spec in (COULOMB, PAYLOAD, CENTRE, BIAS):
        (term,) = found(spec)
        assert term.size == pytest.approx(sizes[spec["name"]])
        assert term.at(1.0) == spec
        half = term.at(0.5)
        strength = np.asarray(spec[term.parameter])
        assert np.allclose(half.pop(term.parameter), 0.5 * strength)
        assert half == {k: v for k, v in spec.items() if k != term.parameter}
    assert found(PAYLOAD)[0].place == "hand"


def test_bounds_are_ratios_of_either_sign():
    friction, bias = found(COULOMB)[0], found(BIAS)[0]
    assert friction.legal()[0] == 0.0
    low, high = bias.legal()
    assert low == pytest.approx(-high) and high == pytest.approx(320.0)


def test_absent_effects_are_left_out():
    terms = [*found(COULOMB), *found(BIAS)]
    assert [spec["name"] for spec in at_ratio(terms, (0.0, 2.0))] == ["sensor_bias"]


def test_a_search_that_names_nothing_adds_nothing():
    for verdict in ("unknown", "no gap", "set-up"):
        assert found(COULOMB, verdict=verdict) == []


def test_laws_of_one_kind_at_one_place_are_one_effect_in_any_order_of_robots():
    searches = [
        found(COULOMB, probability=0.6), found(COULOMB, PAYLOAD, probability=0.7),
        found(STRIBECK, probability=0.9), found(BIAS),
    ]  # fmt: skip
    answers = {tuple(t.key for t in union(order)) for order in itertools.permutations(searches)}
    (keys,) = answers
    assert keys == (
        "coulomb_friction knee torque", "payload hand mass", "sensor_bias knee q",
    )  # fmt: skip
    assert union([*searches, found(STRIBECK)])[-1].effect == "stribeck_friction"


def test_two_laws_of_one_search_both_stay():
    viscous = {"name": "viscous_friction", "joint": "knee", "damping": 0.1}
    assert len(union([found(COULOMB, viscous)])) == 2
