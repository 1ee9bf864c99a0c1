# SPDX-License-Identifier: Apache-2.0
"""The battery's robots in their engine: laws of mechanics, and agreement with the plant.

The first run compiles the kernels, which takes longer than a test should.
"""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest

from loco_workshop.battery.physics import (
    excitation,
    machines,
    motion,
    plant,
    readings,
    slots,
)
from loco_workshop.battery.physics.engine import Engine
from loco_workshop.battery.physics.hidden import Hidden

pytestmark = pytest.mark.usefixtures("short")


def engine(machine):
    return Engine(machine.body, 1e-3, machines.GRAVITY)


def test_a_pendulum_is_the_one_of_the_textbook():
    one = engine(machines.get("servo_pendulum"))
    assert one.mass(np.array([0.3]))[0, 0] == pytest.approx(0.00667 + 0.5 * 0.2**2)
    held = one.needed(np.array([0.3]), np.array([1.7]), np.zeros(1))
    assert held[0] == pytest.approx(0.5 * 9.81 * 0.2 * np.sin(0.3))


def test_what_diverges_is_seen_and_not_set_back_to_the_start(capfd, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)  # the engine writes a log where it stands
    m = machines.get("hyq_leg")
    rows = np.zeros((slots.LAWS, 3, 4))
    rows[slots.VISCOUS, :, 0] = -1e9  # what slows down drives on
    q, _, _ = motion.simulate(
        engine(m), plant.packed(m, m.body), np.zeros((10, 3, 3)), rows, np.full(10, -1.0),
        m.start + 0.1, (0, 4, 1e-3, 4),
    )  # fmt: skip
    assert not np.abs(q[-1]).max() < 1e4
    assert capfd.readouterr().err.count("unstable") + 1 < 5  # told once, not at each step


@pytest.mark.parametrize("name", list(machines.MACHINES))
def test_the_mass_matrix_is_positive_and_gravity_is_the_slope_of_energy(name):
    m = machines.get(name)
    q = m.start + 0.1
    one, none = engine(m), np.zeros(len(q))
    mass = one.mass(q)
    assert np.allclose(mass, mass.T) and np.all(np.linalg.eigvalsh(mass) > 0.0)

    def potential(q):
        one.mass(q)  # puts it there, at rest
        return one.energy()

    held = one.needed(q, none, none)
    for j, step in enumerate(1e-5 * np.eye(len(q))):
        slope = (potential(q + step) - potential(q - step)) / 2e-5
        assert held[j] == pytest.approx(slope, abs=1e-6)


def test_a_leg_without_drives_and_damping_keeps_its_energy():
    m = machines.get("hyq_leg")
    free = plant.loose(m)
    command, rows = np.zeros((250, 3, 3)), np.zeros((slots.LAWS, 3, 4))
    one, dt = Engine(free.body, 1 / 8000, machines.GRAVITY), 1 / 8000
    q, v, _ = motion.simulate(
        one, plant.packed(free, free.body), command, rows, np.full(10, -1.0), m.start,
        (0, 32, dt, 8),
    )  # fmt: skip

    def energy(k):
        one.mass(q[k])
        one.v[:] = v[k]
        return one.energy()

    assert np.ptp(q[:400], axis=0).max() > 0.3  # it falls
    assert energy(400) == pytest.approx(energy(0), abs=1e-3)


def test_what_hits_a_stop_stays_there():
    m = machines.get("linear_axis")
    push = Hidden("push", "carriage", "force", {"link": m.body.links[0], "point": [0.0, 0.0, 0.0],
                  "force": [2000.0, 0.0, 0.0], "start": 0.1, "stop": 0.4})  # fmt: skip
    t, seen, *_ = plant.truth(m, [push], (np.zeros((100, 1)), np.zeros((100, 1))))
    held = seen[(t > 0.3) & (t < 0.4), 0]
    assert np.allclose(held, m.body.upper[0], atol=2e-3)


def test_dry_friction_holds_a_joint():
    m = machines.get("linear_axis")
    stuck = Hidden("coulomb_friction", "slide", "torque", {"torque": 40.0})
    command = np.zeros((50, 1)), np.zeros((50, 1))
    command[0][10:] = 0.01  # 20 N, less than friction
    _, seen, speed, _ = plant.truth(m, [stuck], command)
    assert np.abs(seen).max() < 1e-6 and np.abs(speed).max() < 1e-5


def test_the_answer_hardly_depends_on_the_step():
    m = machines.get("linear_axis")
    moved = excitation.command(m, "chirp", 3)
    one, two, four = (plant.truth(m.with_steps(k), (), moved)[1][:, 0] for k in (16, 32, 64))
    assert np.abs(four).max() > 0.01
    gaps = np.abs(one - two).max(), np.abs(two - four).max()
    assert gaps[0] < 5e-6
    assert gaps[1] < 0.4 * gaps[0]  # it falls with the square of the step


def test_a_machine_that_falls_apart_reads_nothing():
    m = machines.get("linear_axis")
    t = np.linspace(0.0, 1.0, 11)
    lost = np.full((11, 1), np.inf)
    read = readings.joints(m, (), t, lost, lost, t[:5], np.random.default_rng(1))
    assert read.shape == (5, 1) and np.isnan(read).all()


@pytest.mark.parametrize(("name", "limit"), [("linear_axis", 5e-5), ("hyq_leg", 3e-4)])
def test_nothing_hidden_agrees_with_the_plant_as_its_step_shrinks(name, limit):
    from loco_learning.gap.prediction.forward import Forward
    from loco_learning.gap.recordings.record import Record
    from loco_sim.plant.model import Model

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
        "import sys; from loco_workshop.battery import cases; "
        "c = cases.Case('x', 'linear_axis', 'null', '', 1); cases.readings(c); "
        "bad = [m for m in sys.modules if m.split('.')[0] in ('loco_sim', 'pybullet')]; "
        "assert not bad, bad"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=110)
    assert done.returncode == 0, done.stderr
