# SPDX-License-Identifier: Apache-2.0
"""Limbs that are run apart, and known from before, do what they do in the whole robot."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from loco_sim import effects
from loco_sim.bolted import limbs
from loco_sim.bolted.loop import Bolted, Run, Segments
from loco_sim.effects.pulls import Pulls
from loco_sim.effects.rows import CONSTANTS, MEMORY, Laws
from loco_sim.multibody.tree import Tree
from loco_sim.robot import robot

AIR = {"fixed_base": True, "height": 1.0}
KNEE, HIP = "rh_kfe_joint", "lf_hfe_joint"
ONE_LIMB = [
    [],
    [{"name": "payload", "link": "rh_lowerleg", "mass": 0.4}],
    [{"name": "coulomb_friction", "joint": KNEE, "torque": 2.0}],
    [{"name": "actuation_delay", "joint": KNEE, "delay": 0.004}],
    [{"name": "backlash", "joint": HIP, "width": 0.01, "inertia": 0.02},
     {"name": "end_stop", "joint": KNEE, "angle": -1.0, "stiffness": 500.0}],
    [{"name": "cable_force", "link": "rh_lowerleg", "stiffness": 80.0, "anchor": (0.0, 0.0, 1.0)}],
    [{"name": "sensor_gain", "q": 0.05}, {"name": "command_delay", "delay": 0.008}],
]  # fmt: skip
JOINED = [
    [{"name": "supply_sag", "sag": 0.4}],  # all motors on one battery
    [{"name": "coulomb_friction", "torque": 2.0}],  # brakes are settled together
    [{"name": "series_elasticity", "joint": KNEE, "compliance": 1e-3, "inertia": 0.5}],
]


@pytest.fixture(autouse=True)
def kept(monkeypatch) -> limbs.LimbCache:
    found = limbs.LimbCache()
    monkeypatch.setattr(limbs, "CACHE", found)
    return found


def loaded(name: str = "hyq") -> robot.Robot:
    found = robot.load(name, AIR)
    return replace(found, sensors=found.sensors.replace(exact=True)) if found.sensors else found


def commands(plant: robot.Robot, rows: int = 120) -> tuple[np.ndarray, np.ndarray]:
    t = np.arange(rows) / plant.control_rate
    wave = np.sin(2.0 * np.pi * np.outer(t, 1.0 + 0.3 * np.arange(len(plant.joints))))
    return plant.standing + 0.3 * wave, wave


def whole(plant: Bolted, *told, **more) -> Run:
    plant._limb_indices = []
    return plant.run(*told, **more)


def equal(first: Run, second: Run) -> None:
    for a, b in zip(first, second, strict=True):
        np.testing.assert_array_equal(a, b)


@pytest.mark.parametrize("seed", range(20))
def test_each_joint_is_in_one_limb_with_the_one_before_it(seed):
    rng = np.random.default_rng(seed)
    before = np.array([rng.integers(-1, i) if i else -1 for i in range(9)])
    found = limbs.limb_indices(np.stack([before, np.zeros(9, int)], axis=1))
    assert sorted(np.concatenate(found)) == list(range(9))
    assert len(found) == np.sum(before < 0)
    home = {i: k for k, limb in enumerate(found) for i in limb}
    assert all(home[i] == home[p] for i, p in enumerate(before) if p >= 0)


@pytest.mark.parametrize(
    ("name", "specs"),  # knees of Tigrillo have springs alone, and lie at their stops in the air
    [*(("hyq", specs) for specs in ONE_LIMB), ("tigrillo", []), ("tigrillo", ONE_LIMB[-1])],
)
def test_apart_is_the_whole_to_the_last_bit(kept, name, specs):
    plant = loaded(name)
    made = effects.from_list(specs)
    told = commands(plant)
    found = Bolted(plant, made).run(*told)
    assert kept.requested == 4
    equal(found, whole(Bolted(plant, made), *told))


def test_pieces_begin_in_each_limb_where_they_do_in_the_whole(kept):
    plant, rng = loaded(), np.random.default_rng(3)
    starts = plant.standing + 0.1 * rng.standard_normal((2, 3, 12))
    more = {"segments": Segments(np.array([[5, 50], [60, 120]]), starts)}
    told = commands(plant)
    equal(Bolted(plant).run(*told, **more), whole(Bolted(plant), *told, **more))
    assert kept.requested == 4


@pytest.mark.parametrize("specs", JOINED, ids=lambda s: s[0]["name"])
def test_what_joins_limbs_is_run_whole(kept, specs):
    Bolted(loaded(), effects.from_list(specs)).run(*commands(loaded()))
    assert kept.requested == 0


def test_only_the_limb_that_changes_is_run_again(kept):
    plant = loaded()
    q, dq = commands(plant)
    first = Bolted(plant).run(q, dq)
    Bolted(plant).run(q, dq)
    assert (kept.requested, kept.hits) == (8, 4)
    q = q.copy()
    q[50:, plant.joints.index(KNEE)] += 0.1
    second = Bolted(plant).run(q, dq)
    assert (kept.requested, kept.hits) == (12, 7)
    mine = [joint.startswith("rh_") for joint in plant.joints]
    np.testing.assert_array_equal(first.q[:, ~np.array(mine)], second.q[:, ~np.array(mine)])
    assert np.any(first.q[:, mine] != second.q[:, mine])


def test_what_is_given_away_may_be_changed(kept):
    plant, told = loaded(), commands(loaded())
    first = Bolted(plant).run(*told)
    as_it_was = first.q.copy()
    first.q[:] = 7.0
    np.testing.assert_array_equal(Bolted(plant).run(*told).q, as_it_was)


def test_nothing_is_known_of_a_robot_whose_limb_is_lost():
    plant = loaded()
    q, dq = commands(plant)
    q[60:, plant.joints.index(KNEE)] = np.nan
    found, wanted = Bolted(plant).run(q, dq), whole(Bolted(plant), q, dq)
    lost = np.isnan(wanted.q).any(axis=1)
    assert 0 < lost.sum() < len(lost)
    equal(found, wanted)


def test_no_more_is_kept_than_is_allowed():
    plant, (q, dq) = loaded(), commands(loaded())
    one = len(q) * 9 * 8  # bytes of a leg
    kept = limbs.CACHE = limbs.LimbCache(6 * one)
    for k in range(5):
        Bolted(plant).run(q + 0.01 * k, dq)
    assert len(kept._runs) == 6 and kept._size == 6 * one
    Bolted(plant).run(q + 0.04, dq)
    assert kept.hits == 4
    Bolted(plant).run(q, dq)
    assert kept.hits == 4


def test_two_limbs_that_are_the_same_are_kept_once(kept):
    a, b = (np.zeros((4, 3, 2)) for _ in range(2))
    kept._keep(b"leg", a)
    kept._keep(b"leg", b)
    assert kept._size == a.nbytes and len(kept._runs) == 1


def orders() -> limbs.RunInputs:
    rng = np.random.default_rng(0)
    laws = Laws(
        np.array([[0, 0, 1, 0, 9]]), np.zeros(1, int), rng.random((1, CONSTANTS)),
        np.zeros((1, MEMORY)), np.zeros(3),
    )  # fmt: skip
    return limbs.RunInputs(
        Tree(np.zeros((2, 2), int), rng.random((2, 32)), 100.0), np.arange(2), rng.random(3),
        np.zeros((1, 2), int), rng.random((1, 2, 2)), rng.random((4, 4, 2)), np.arange(4),
        rng.random((4, 2)), rng.random((2, 9)), rng.random((2, 7)), rng.random((2, 2)), laws, laws,
        Pulls(np.zeros(1, int), np.zeros((1, 2), int), rng.random((1, 11))), rng.random((1, 2)),
        False, 0.001,
    )  # fmt: skip


def otherwise(value):
    """The same with another last number."""
    if not isinstance(value, np.ndarray):
        return value + 1
    value = value.copy()
    value.flat[-1] += 1
    return value


@pytest.mark.parametrize("name", limbs.RunInputs._fields)
def test_orders_that_differ_in_one_number_are_told_apart(kept, name):
    def key(**changed) -> bytes:
        (found,) = kept.keys(orders()._replace(**changed), [np.arange(2)])
        return found

    value, known = getattr(orders(), name), key()
    assert key() == known
    if not isinstance(value, tuple):
        changed = value[::-1] if name == "order" else otherwise(value)
        assert key(**{name: changed}) != known
        return
    for part in value._fields:
        changed = value._replace(**{part: otherwise(getattr(value, part))})
        same = key(**{name: changed}) == known
        assert same == (part in ("memory", "line"))  # which a run sets to zero itself
