# SPDX-License-Identifier: Apache-2.0
"""Drawn robots stand, move and are what their robot.yaml says."""

from __future__ import annotations

import json
from dataclasses import replace

import numpy as np
import pytest

from loco_bringup.cli.table import parser
from loco_bringup.gap.importing import load
from loco_control.exceptions import ParameterError
from loco_learning.gap.prediction.forward import Forward
from loco_workshop.battery import bags, battery, cases, score, trial
from loco_workshop.battery.drawn import bodies, drives, fleet
from loco_workshop.battery.physics import excitation, kinds, machines, plant, slots
from loco_workshop.battery.physics.engine import Engine
from loco_workshop.battery.physics.machines import GRAVITY, Sensor

pytestmark = pytest.mark.xdist_group("drawn")  # one process draws each robot once

# One for every kind of drive, with a sampled torque, springs, limbs, slides among them.
SHOWN = {
    1: "impedance held", 5: "cascade held", 11: "pid", 16: "pid held", 21: "servo held",
    24: "velocity", 33: "weight", 34: "torque",
}  # fmt: skip


def silent(machine):
    """The machine with sensors that neither round nor add noise."""
    quiet = None if machine.speed_noise is None else 0.0 * machine.speed_noise
    return replace(
        machine, jitter=0.0, sensors=(Sensor(),) * len(machine.joints), torque_noise=0.0,
        speed_noise=quiet,
    )  # fmt: skip


@pytest.mark.parametrize("number", list(SHOWN))
def test_nothing_hidden_is_nothing_to_the_search_as_its_step_shrinks(number, tmp_path):
    """Body, drive, springs, sampling and commands of the generator are those of robot.yaml."""
    name = f"drawn_{number}"
    machine = fleet.get(name)
    record = min(machine.records, key=lambda r: r.seconds)
    moved = excitation.command(machine, record.name, 1)
    bags.write_bag(tmp_path / "fit", plant.record(silent(machine), (), moved, 1, "x"), name)
    model = trial.model_of(name)
    forward = Forward(model, load(tmp_path / "fit", model.make_robot()))
    near, nearer = forward(step=0.25)[0], forward(step=0.125)[0]
    n = len(machine.joints)
    noise = [np.hypot(s.noise, s.step / np.sqrt(12.0)) for s in machine.sensors]
    left = (forward.measured[0] - (2.0 * nearer - near))[:, :n]  # its error is that of order 1
    coarse = (forward.measured[0] - near)[:, :n]
    rms, of_step = (np.sqrt(np.nanmean(np.square(x), axis=0)) / noise for x in (left, coarse))
    assert np.all(rms < 1.0 + 0.1 * of_step), (machine.drive, rms)


def test_the_integration_of_the_generator_is_exact_to_a_part_of_the_noise():
    """An encoder of a fine step would else tell an error of the generator as a gap."""
    machine = fleet.get("drawn3_118120009")
    record = min(machine.records, key=lambda r: r.seconds)
    moved = excitation.command(machine, record.name, 1)
    here, finer = (
        plant.truth(machine.with_steps(by * machine.steps), (), moved)[:2] for by in (1, 4)
    )
    a, b = (seen[:: round(1.0 / (machine.rate * t[1]))] for t, seen in (here, finer))
    noise = np.array([np.hypot(s.noise, s.step / np.sqrt(12.0)) for s in machine.sensors])
    assert np.all(np.sqrt(np.mean((a - b) ** 2, axis=0)) < 1.2 * fleet.INEXACT * noise)


def test_all_kinds_of_drive_are_drawn():
    assert {number: fleet.get(f"drawn_{number}").drive for number in SHOWN} == SHOWN
    assert {kind.removesuffix(" held") for kind in SHOWN.values()} == set(drives.KINDS)


def test_a_number_is_one_robot():
    one, again = fleet.get("drawn_11"), fleet.draw.__wrapped__("drawn_11")
    assert one is not again and one.urdf == again.urdf and one.about == again.about
    assert fleet.get("drawn_5").urdf != one.urdf


def test_the_number_of_joints_can_be_limited():
    joints = [len(fleet.get(f"drawn2_{number}").joints) for number in range(1, 6)]
    assert joints.count(2) > 1 and max(joints) <= 2
    assert fleet.is_family("drawn12") and not fleet.is_family("drawn0")
    assert not fleet.is_drawn("drawn13_1")


@pytest.mark.parametrize("seed", range(40))
def test_bodies_are_possible(seed):
    """Inertias obey the triangle inequality, joints are listed depth first, poses within limits."""
    body, root = bodies.draw(np.random.default_rng(seed))
    n = len(body.joints)
    ones = np.ones(n)
    tree = fleet.tree.read(bodies.finished(root, ones, 0.1 * ones, ones), body.joints)
    assert 1 <= n <= bodies.MOST and np.all(body.parent < np.arange(n)) and np.all(tree.mass > 0.0)
    for inertia in tree.inertia:
        least, middle, most = np.linalg.eigvalsh(inertia)
        assert 0.0 < least and most <= least + middle
    assert np.all(tree.lower < body.start) and np.all(body.start < tree.upper)
    assert np.all(np.linalg.eigvalsh(Engine(tree, 1e-3, GRAVITY).mass(body.start)) > 0.0)


def test_joints_that_are_not_listed_depth_first_are_refused():
    """The engine numbers them depth first, and its arrays are used as they are."""
    tree = machines.get("hyq_air").body
    order = [0, 3, *(j for j in range(12) if j not in (0, 3))]
    names = [tree.joints[j] for j in order]
    wrong = fleet.tree.read(machines._urdf("hyq"), names)
    with pytest.raises(ValueError, match="depth first"):
        Engine(wrong, 1e-3, GRAVITY)


def test_poles_are_those_of_the_textbook():
    rows, springs = np.zeros((1, slots.DRIVE)), np.zeros((1, slots.SPRING))
    rows[0, :3] = slots.IMPEDANCE, 16.0, 4.0
    mass, weight = np.array([[2.0]]), np.array([[2.0]])
    found = drives.poles(rows, springs, mass, weight)
    assert np.allclose(np.sort_complex(found), np.sort_complex(np.roots([2.0, 4.0, 18.0])))
    rows[0, 3] = 10.0  # the integrator adds a pole
    expected = np.roots([2.0, 4.0, 18.0, 10.0])
    found = drives.poles(rows, springs, mass, weight)
    assert np.allclose(np.sort_complex(found), np.sort_complex(expected))


def test_integrators_are_at_rest_when_a_record_begins_and_the_bag_says_so(tmp_path):
    machine = fleet.get("drawn_11")
    assert machine.integrates
    moved = excitation.command(machine, machine.records[0].name, 1)
    _, seen, speed, _ = plant.truth(machine, (), moved)
    assert np.abs(speed[0]).max() < 1e-3 * np.max(machine.fast)
    bags.write_bag(tmp_path / "fit", plant.record(machine, (), moved, 1, "x"), "drawn_11")
    (record,) = load(tmp_path / "fit", trial.model_of("drawn_11").make_robot())
    rest = max(plant.SETTLE, machine.settle)
    assert record.duration == pytest.approx(moved[0].shape[0] / machine.rate + rest, abs=0.05)
    assert record.guessed["q"][: int(0.9 * rest / record.dt)].all()


def test_each_case_draws_its_robot_and_is_the_same_after_its_truth_file():
    planned = cases.plan(20, 3, ["drawn"])
    assert len({case.robot for case in planned}) == 20
    null = next(case for case in planned if case.kind == "null")
    case = cases.from_truth(json.loads(json.dumps(cases.truth(cases.fill(null)))))
    made, again = cases.readings(null), cases.readings(case)
    assert list(made) == list(again)
    assert all(made[name].q.tobytes() == again[name].q.tobytes() for name in made)


@pytest.mark.parametrize("name", ["worn_spot", "hum", "torque_bias", "torque_ripple",
                                  "constant_force"])  # fmt: skip
def test_an_effect_moves_a_drawn_robot(name):
    machine = fleet.get("drawn_8")
    effect, low, high = kinds.draw(name, machine, np.random.default_rng(2))
    moved = excitation.command(machine, machine.records[0].name, 1)
    bare = plant.truth(machine, (), moved)[1]
    with_it = plant.truth(machine, [effect.scaled(high)], moved)[1]
    assert np.abs(with_it - bare).max() > 5.0 * machine.sensors[0].noise


def test_a_wrong_zero_is_only_hidden_in_a_loop_on_the_position():
    assert kinds.draw("joint_offset", fleet.get("drawn_24"), np.random.default_rng(1)) is None
    assert kinds.draw("joint_offset", fleet.get("drawn_5"), np.random.default_rng(1)) is not None


def test_the_score_groups_drawn_robots_by_joints_and_drive():
    assert fleet.groups(fleet.get("drawn_11")) == ("drawn, 1 joint", "drawn, pid")
    assert fleet.groups(fleet.get("hyq_leg")) == ("hyq_leg",)
    assert score.STRAIGHT in score.twins_of("linear_axis")


def test_options_for_listed_robots_are_refused():
    a = parser("gap battery").parse_args(["--robots", "drawn", "--follow"])
    with pytest.raises(ParameterError, match="--follow is for listed robots"):
        battery.check(a)
