# SPDX-License-Identifier: Apache-2.0
"""Equations of motion of the battery's robots: laws of mechanics, and agreement with the plant.

The first run compiles the kernels, which takes longer than a test should.
"""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest

from loco_learning.gap.battery import bodies, excitation, machines, motion, plant, readings, slots
from loco_learning.gap.battery.hidden import Hidden


def matrices(machine, q, dq):
    body, held = bodies.of(machine.body), np.zeros(len(q))
    bodies.poses(q, body)
    bodies.mass_matrix(body)
    bodies.bias(dq, body, machines.GRAVITY, held)
    return body.mass, held, body.links


def potential(machine, q):
    _, _, links = matrices(machine, q, np.zeros(len(q)))
    return machines.GRAVITY * float(machine.body.mass @ links[:, bodies.COM + 2])


def test_a_pendulum_is_the_one_of_the_textbook():
    m = machines.get("servo_pendulum")
    mass, held, _ = matrices(m, np.array([0.3]), np.array([1.7]))
    assert mass[0, 0] == pytest.approx(0.00667 + 0.5 * 0.2**2)
    assert held[0] == pytest.approx(0.5 * 9.81 * 0.2 * np.sin(0.3))


@pytest.mark.parametrize("name", list(machines.MACHINES))
def test_the_mass_matrix_is_positive_and_gravity_is_the_slope_of_energy(name):
    m = machines.get(name)
    q = m.start + 0.1
    mass, held, _ = matrices(m, q, np.zeros(len(q)))
    assert np.allclose(mass, mass.T) and np.all(np.linalg.eigvalsh(mass) > 0.0)
    for j in range(len(q)):
        step = np.zeros(len(q))
        step[j] = 1e-5
        slope = (potential(m, q + step) - potential(m, q - step)) / 2e-5
        assert held[j] == pytest.approx(slope, abs=1e-6)


def test_a_leg_without_drives_and_damping_keeps_its_energy():
    m = machines.get("hyq_leg")
    free = plant.loose(m)
    command = np.zeros((250, 3, 3))
    packed = plant.packed(free, free.body)
    rows = np.zeros((slots.LAWS, 3, 4))
    q, v, _ = motion.simulate(packed, command, rows, np.full(10, -1.0), m.start, 0, 32, 1 / 8000, 8)

    def energy(k):
        mass, _, _ = matrices(m, q[k], v[k])
        return 0.5 * v[k] @ mass @ v[k] + potential(m, q[k])

    assert np.ptp(q[:400], axis=0).max() > 0.3  # it falls
    assert energy(400) == pytest.approx(energy(0), abs=1e-3)


def test_solved_is_linear_algebra():
    rng = np.random.default_rng(1)
    a = rng.normal(size=(4, 4))
    a = a @ a.T + np.eye(4)
    b = rng.normal(size=4)
    x = b.copy()
    low = np.zeros((4, 4))
    bodies.factored(a, low)
    bodies.solved(low, x)
    assert np.allclose(a @ x, b)


def test_dry_friction_holds_a_joint_to_the_last_bit():
    m = machines.get("linear_axis")
    stuck = Hidden("coulomb_friction", "slide", "torque", {"torque": 40.0})
    command = np.zeros((50, 1)), np.zeros((50, 1))
    command[0][10:] = 0.01  # 20 N, less than friction
    _, seen, speed, _ = plant.truth(m, [stuck], command)
    assert np.all(seen == 0.0) and np.all(speed == 0.0)


def test_the_answer_does_not_depend_on_the_step():
    m = machines.get("linear_axis")
    moved = excitation.command(m, "chirp", 3)
    fine, coarse = plant.truth(m, (), moved), plant.truth(m.with_steps(16), (), moved)
    assert np.abs(fine[1]).max() > 0.01
    a = np.interp(coarse[0], fine[0], fine[1][:, 0])
    assert np.abs(a - coarse[1][:, 0]).max() < 1e-6


def test_a_machine_that_falls_apart_reads_nothing():
    m = machines.get("linear_axis")
    t = np.linspace(0.0, 1.0, 11)
    lost = np.full((11, 1), np.inf)
    read = readings.joints(m, (), t, lost, lost, t[:5], np.random.default_rng(1))
    assert read.shape == (5, 1) and np.isnan(read).all()


@pytest.mark.parametrize(("name", "limit"), [("linear_axis", 5e-5), ("hyq_leg", 3e-4)])
def test_nothing_hidden_agrees_with_the_plant_as_its_step_shrinks(name, limit):
    from loco_learning.gap.forward import Forward
    from loco_learning.gap.record import Record
    from loco_sim.model import Model

    m = machines.get(name)
    moved = excitation.command(m, "mix", 4)
    r = plant.record(m, (), moved, 0)
    command = {"position": r.command, "velocity": r.rate}
    record = Record("null", r.t, command, r.driven, {"q": r.q}, r.joints)
    forward = Forward(Model(name, dict(m.overrides)), [record])
    errors = []
    for step in (0.5, 0.25, 0.125):
        gap = forward.measured[0] - forward(step=step)[0]
        errors.append(float(np.sqrt(np.nanmean(gap**2))))
    noise = max(s.noise for s in m.sensors)
    assert errors[2] < errors[1] < errors[0]
    assert errors[2] < limit + noise


def test_making_a_case_loads_nothing_of_the_plant():
    code = (
        "import sys; from loco_learning.gap.battery import cases; "
        "c = cases.Case('x', 'linear_axis', 'null', '', 1); cases.readings(c); "
        "bad = [m for m in sys.modules if m.split('.')[0] in ('loco_sim', 'pybullet')]; "
        "assert not bad, bad"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=110)
    assert done.returncode == 0, done.stderr
