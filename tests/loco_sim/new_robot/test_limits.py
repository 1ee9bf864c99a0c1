# SPDX-License-Identifier: Apache-2.0
"""Limits that a URDF leaves out, and swings that fit into them."""

from __future__ import annotations

import xml.etree.ElementTree as ET

import numpy as np
import pytest

from loco_sim.new_robot import gains, limits
from loco_sim.new_robot.body import Body
from loco_sim.robot.description import Description

from ..trees import random_urdf

SEEDS = range(3)


@pytest.fixture(params=SEEDS)
def arm(request) -> tuple[Body, str]:
    urdf, _ = random_urdf(request.param)
    return Body(Description(urdf)), urdf


def guessed(body: Body, urdf: str, wheels: dict | None = None) -> tuple[list[str], ET.Element]:
    root, rng = ET.fromstring(urdf), np.random.default_rng(0)
    loads = body.weight_torque(np.zeros(len(body.joints)), [], np.zeros((0, 3)))
    names, notes = limits.guess(root, body, loads, wheels or {}, 1.0, rng)
    assert notes == []
    return list(dict.fromkeys(name for name, _ in names)), root


def limit_of(root: ET.Element, joint: str) -> dict[str, float]:
    (found,) = (j.find("limit") for j in root.findall("joint") if j.get("name") == joint)
    return {key: float(found.get(key)) for key in ("effort", "velocity")}


def test_limits_that_are_there_stay(arm):
    body, urdf = arm
    names, root = guessed(body, urdf)
    assert names == [] and ET.tostring(root) == ET.tostring(ET.fromstring(urdf))


@pytest.mark.parametrize("said", ['effort="0" velocity="100"', 'velocity="100"'])
def test_an_effort_that_is_missing_or_nothing_holds_the_robot_in_any_posture(arm, said):
    body, urdf = arm
    names, root = guessed(body, urdf.replace('effort="100" velocity="100"', said))
    assert names == list(body.joints)
    efforts = np.array([limit_of(root, joint)["effort"] for joint in body.joints])
    for seed in range(20):
        q = np.random.default_rng(seed).uniform(-3.0, 3.0, len(body.joints))
        assert np.all(np.abs(body.weight_torque(q, [], limits.NO_FEET)) < efforts)
    assert all(limit_of(root, joint)["velocity"] == 100.0 for joint in body.joints)


def rod(kind: str, axis: str, effort: str) -> tuple[Body, ET.Element]:
    """A body of 2 kg, 0.4 m from its joint; a second one carries nothing, with the same limit."""
    inertia = '<inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/>'
    link = f'<inertial><origin xyz="0.4 0 0"/><mass value="2"/>{inertia}</inertial>'
    joints = "".join(
        f'<joint name="{name}" type="{kind}"><parent link="base"/><child link="{name}_link"/>'
        f'<axis xyz="{along}"/><limit lower="-1" upper="1" velocity="1" effort="{effort}"/></joint>'
        f'<link name="{name}_link">{link}</link>'
        for name, along in (("loaded", axis), ("free", "0 0 1" if kind == "revolute" else "0 1 0"))
    )
    urdf = f'<robot name="rod"><link name="base"/>{joints}</robot>'
    return Body(Description(urdf)), ET.fromstring(urdf)


@pytest.mark.parametrize(
    ("kind", "axis", "effort", "needs"),
    [
        ("revolute", "0 1 0", "1", "its weight alone needs 7.8"),
        ("prismatic", "0 0 1", "1.0", "its weight alone needs 19.6 N:"),
        ("prismatic", "1 0 0", "0.05", "an acceleration of 0.1 m/s² needs 0.2 N:"),
    ],
)
def test_an_effort_limit_far_below_what_the_weight_needs_is_not_used(kind, axis, effort, needs):
    body, root = rod(kind, axis, effort)
    loads = np.zeros(len(body.joints))
    names, notes = limits.guess(root, body, loads, {}, 1.0, np.random.default_rng(0))
    assert ("loaded", "effort") in names
    (note,) = [note for note in notes if note.startswith("loaded: ")]
    assert f"effort limit {float(effort):g} N" in note and needs in note
    assert "not used (guessed" in note and "correct <limit effort>" in note
    weight = np.abs(body.weight_torque(np.zeros(2), [], limits.NO_FEET))
    assert limit_of(root, "loaded")["effort"] > weight[body.joints.index("loaded")]
    if float(effort) == 1.0:  # enough for the other one, which carries nothing
        assert limit_of(root, "free")["effort"] == 1.0


@pytest.mark.parametrize("share", [0.4, 2.0])
def test_a_weak_joint_keeps_its_limit(share):
    """Of Baxter or a pendulum that swings itself up: weaker than its weight, but no placeholder."""
    body, root = rod("revolute", "0 1 0", f"{share * 2.0 * 9.81 * 0.4:.4g}")
    names, notes = limits.guess(root, body, np.zeros(2), {}, 1.0, np.random.default_rng(0))
    assert names == [] and notes == []


def test_a_wheel_is_as_strong_as_the_ground_can_hold(arm):
    body, urdf = arm
    joint = next(k for k in range(len(body.joints)) if not body.slides[k])
    bare = urdf.replace('effort="100" velocity="100"', 'effort="0" velocity="0"')
    _, root = guessed(body, bare, {joint: 0.1})
    weight = body.mass.sum() * limits.GRAVITY
    found = limit_of(root, body.joints[joint])
    assert found["effort"] == pytest.approx(limits.GRIP * weight * 0.1, rel=0.01)


def test_a_swing_that_the_efforts_hold_stays_as_it_is(arm):
    body, _ = arm
    q, swing = np.zeros(len(body.joints)), np.full(len(body.joints), 0.2)
    strong = np.full(len(q), 1e4)
    at, amplitude, told = limits.held(body, q, swing, strong, 3.0)
    assert at is q and amplitude is swing and told == []


@pytest.mark.parametrize("share", [0.9, 0.3])
def test_a_swing_that_is_too_much_is_moved_or_made_smaller_and_told(arm, share):
    body, _ = arm
    q, swing = np.zeros(len(body.joints)), np.full(len(body.joints), 0.2)
    effort = np.maximum(share * limits.demand(body, q, swing, 3.0), 1e-3)
    at, amplitude, (text,) = limits.held(body, q, swing, effort, 3.0)
    before, after = (
        np.square(np.maximum(limits.demand(body, *way, 3.0) / effort - limits.HOLDS, 0.0)).sum()
        for way in ((q, swing), (at, amplitude))
    )
    assert after < before
    assert np.all(at >= body.low) and np.all(at <= body.high)
    assert np.all(amplitude <= swing) and np.all(amplitude >= swing / limits.SMALLEST)
    worst = body.joints[int(np.argmax(limits.demand(body, q, swing, 3.0) / effort))]
    assert f"{worst!r} would need" in text
    assert ("moved)" in text) == bool(np.any(at != q))
    assert ("as far" in text) == bool(np.any(amplitude != swing))


@pytest.mark.parametrize("bolted", [True, False])
def test_gains_hold_the_weight_and_are_stable_at_their_steps(arm, bolted):
    body, _ = arm
    q, end = np.zeros(len(body.joints)), body.leaf_bodies()[-1]
    feet = body.forward(q)[1][[end]]
    found = gains.choose(body, q, feet, [end], [], bolted)
    load = np.abs(body.weight_torque(q, [] if bolted else [end], feet))
    sag = np.where(body.slides, gains.SLIDE_SAG, gains.SAG)
    assert np.all(load / found.kp <= sag * (1.0 + 1e-9))
    inertia = body.inertia(q, bolted) + np.diag(found.armature)
    dt = 1.0 / (gains.PHYSICS_RATE * found.steps)
    modes = np.linalg.eigvals(np.linalg.solve(inertia, np.diag(found.kd + body.damping)))
    assert dt * np.abs(modes).max() <= 0.5 + 1e-6 < 2.0  # where explicit damping diverges
    assert 1 <= found.steps <= gains.STEPS
    assert np.all(found.armature >= 0.0) and np.all(found.armature[body.slides] == 0.0)


def test_stiffer_is_stiffer_and_a_wheel_has_a_speed_to_follow_alone(arm):
    body, _ = arm
    q, joint = np.zeros(len(body.joints)), 0
    given = body, q, np.zeros((0, 3)), [], [joint], True
    soft, stiff = gains.choose(*given), gains.choose(*given, stiffer=2.0)
    others = np.arange(len(q)) != joint
    assert stiff.kp[others] == pytest.approx(2.0 * soft.kp[others])
    assert soft.kp[joint] == 0.0 and soft.kd[joint] > 0.0
