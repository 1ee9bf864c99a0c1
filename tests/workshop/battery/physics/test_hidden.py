# SPDX-License-Identifier: Apache-2.0
"""What is hidden does what it says."""

from __future__ import annotations

import numpy as np
import pytest

from loco_workshop.battery.physics import excitation, kinds, machines, plant, readings
from loco_workshop.battery.physics.hidden import Hidden, constants, from_dict, to_dict

pytestmark = pytest.mark.usefixtures("short")

TICKS = np.arange(250) / 250  # of the linear axis


def moved(machine, kind="chirp"):
    return excitation.command(machine, kind, 3)


def bare(machine, effects=(), kind="chirp", seed=1):
    return plant.record(machine, effects, moved(machine, kind), seed, "x")


def test_the_same_seed_gives_the_same_bytes_and_another_other_noise():
    m = machines.get("linear_axis")
    assert bare(m).q.tobytes() == bare(m).q.tobytes()
    assert bare(m).q.tobytes() != bare(m, seed=2).q.tobytes()


def test_a_late_command_and_a_late_sensor_look_the_same():
    m = machines.get("linear_axis")
    late = 0.006
    a = plant.truth(m, [Hidden("command_delay", "", "delay", {"delay": late})], moved(m))
    r = readings.joints(
        m, [Hidden("sensor_latency", "", "delay", {"delay": late})],
        *plant.truth(m, (), moved(m))[:3], TICKS, np.random.default_rng(0),
    )  # fmt: skip
    exact = np.interp(TICKS, a[0], a[1][:, 0])
    assert np.abs(exact - r[:, 0]).max() < 5e-4 and np.std(exact - r[:, 0]) < 8e-5


@pytest.mark.parametrize("name", list(kinds.KINDS))
def test_each_effect_shows_on_a_robot_that_can_have_it(name):
    rng = np.random.default_rng(5)
    for robot in ("linear_axis", "hyq_leg"):
        m = machines.get(robot)
        drawn = kinds.draw(name, m, rng)
        if drawn is None:
            continue
        effect, low, high = drawn
        strong = effect.scaled(np.sqrt(low * high) * (high / low) ** 0.35)
        if name == "push":
            strong.params.update(start=0.3, stop=0.8)
        gap = bare(m, [strong], "steps").q - bare(m, (), "steps").q
        assert np.all(np.isfinite(gap))
        if np.abs(gap).max() > 1e-4:
            return
    assert kinds.KINDS[name].among == "sprung"


@pytest.mark.parametrize("name", list(kinds.OUTSIDERS))
def test_each_outsider_shows(name):
    m = machines.get("linear_axis")
    effect, low, high = kinds.draw(name, m, np.random.default_rng(5))
    if name == "torque_jump":
        effect.params["time"] = 0.5
    gap = bare(m, [effect.scaled(0.5 * high)]).q - bare(m).q
    assert np.all(np.isfinite(gap)) and np.abs(gap).max() > 1e-4


def test_scaling_keeps_sign_and_direction():
    a = Hidden("sensor_bias", "slide", "q", {"q": -1.0}).scaled(0.02)
    assert a.params["q"] == -0.02 and a.size == 0.02
    b = Hidden("com_offset", "rod", "offset", {"offset": [3.0, 0.0, -4.0]}).scaled(0.1)
    assert np.allclose(b.params["offset"], [0.06, 0.0, -0.08])
    assert from_dict(to_dict(b)) == b


def test_patterns_put_an_effect_on_several_joints():
    m = machines.get("tigrillo")
    rows = constants(m, [Hidden("coulomb_friction", "*_hfe_joint", "torque", {"torque": 0.2})])
    assert np.count_nonzero(rows) == 4


def test_friction_takes_energy_and_slows():
    m = machines.get("linear_axis")
    strong = Hidden("viscous_friction", "slide", "damping", {"damping": 60.0})
    assert np.ptp(bare(m, [strong]).q) < np.ptp(bare(m).q)


def test_a_hall_sensor_is_fine_where_its_magnet_is_near():
    m = machines.get("tigrillo")
    q = np.linspace(0.9, 2.0, 400)
    said = readings._read(q, m.sensors[1], np.random.default_rng(0))
    near, far = np.abs(said - q)[q < 1.0], np.abs(said - q)[q > 1.8]
    assert near.max() < 2e-3 < far.max() < 0.1


def test_commands_stay_within_their_limits():
    for name in machines.MACHINES:
        m = machines.get(name)
        for record in m.records:
            q, v, effort = excitation.command(m, record.name, 9)
            assert not effort.any()
            assert np.all(np.abs(q - m.centre) <= m.span + 1e-12)
            assert np.all(q >= m.body.lower[m.driven]) and np.all(q <= m.body.upper[m.driven])
            assert np.abs(v).max() <= m.fast
            assert np.all(q[0] == m.centre) and np.all(v[0] == 0.0)
