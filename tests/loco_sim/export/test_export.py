# SPDX-License-Identifier: Apache-2.0
"""Models as other simulators read them: constants where they belong, and nothing lost silently."""

from __future__ import annotations

import ast
import re

import mujoco
import numpy as np
import pytest

from loco_sim.bolted.loop import Bolted
from loco_sim.effects import EFFECTS, from_list
from loco_sim.export import isaac, ranges, replay_mjcf
from loco_sim.export.mjcf import dofs, mjcf
from loco_sim.export.portable import ELASTIC, RIGID, portable
from loco_sim.export.urdf import urdf
from loco_sim.plant.model import Model
from loco_sim.robot.description import Description

AIR = {"fixed_base": True, "height": 1.0}
TERM = {
    "effect": "coulomb_friction", "place": "lf_hfe_joint",
    "parameters": {"torque": {"value": 0.05, "low": 0.04, "high": 0.07, "unit": "N·m"}},
}  # fmt: skip
FRICTION = {"name": "coulomb_friction", "joint": "lf_hfe_joint", "torque": 0.05}


def compiled(model, gear=RIGID):
    text, lost = mjcf(portable(model, gear))
    return mujoco.MjModel.from_xml_string(text), lost


@pytest.mark.parametrize("name", ["hyq", "tigrillo", "pendulum", "servo_pendulum", "linear_axis"])
def test_the_file_has_the_mass_and_a_drive_for_each_driven_joint(name):
    model = Model(name)
    robot = model.make_robot()
    made, _ = compiled(model)
    assert made.body_mass.sum() == pytest.approx(robot.mass, rel=1e-4)
    driven = [robot.joints[i] for i in robot.driven]
    assert [made.actuator(i).name for i in range(made.nu)] == driven
    assert made.nsensor == 0  # those of our plant, which MJX cannot read


def test_a_held_drive_gives_its_law_within_its_limit():
    made, _ = compiled(Model("hyq", AIR, [{"name": "torque_constant_error", "error": -0.2}]))
    data = mujoco.MjData(made)
    joint, knee = made.joint("lf_kfe_joint"), made.actuator("lf_kfe_joint")
    at, speed = float(data.qpos[joint.qposadr[0]]), 2.0
    data.qvel[joint.dofadr[0]] = speed
    for error in (0.1, 50.0):
        data.ctrl[knee.id] = at + error
        mujoco.mj_forward(made, data)
        wanted = 0.8 * min(150.0 * error - 6.0 * speed, 150.0)
        assert data.actuator_force[knee.id] == pytest.approx(wanted, rel=1e-6)


def test_the_tension_spring_of_a_knee_pulls_as_here():
    spring = Model("tigrillo").make_robot().springs["lf_kfe_joint"]
    made, _ = compiled(Model("tigrillo", AIR))
    data = mujoco.MjData(made)
    joint = made.joint("lf_kfe_joint")
    for q in (1.0, 1.5, 2.1):
        data.qpos[joint.qposadr[0]] = q
        mujoco.mj_forward(made, data)
        f, t = spring.femur, spring.tibia
        length = np.sqrt(f * f + t * t - 2.0 * f * t * np.cos(q))
        wanted = -spring.stiffness * (length - spring.length) * f * t * np.sin(q) / length
        assert data.qfrc_spring[joint.dofadr[0]] == pytest.approx(wanted, rel=1e-4)


def test_a_rotor_stands_where_its_joint_does_and_has_a_dof_of_its_own():
    robot = Model("tigrillo").make_robot()
    elastic, rigid = (compiled(Model("tigrillo"), gear)[0] for gear in (ELASTIC, RIGID))
    assert rigid.nv == 6 + len(robot.joints)
    assert elastic.nv == rigid.nv + len(robot.driven) and elastic.nu == rigid.nu
    data = mujoco.MjData(elastic)
    mujoco.mj_resetDataKeyframe(elastic, data, 0)
    mujoco.mj_forward(elastic, data)
    for i in robot.driven:
        name = robot.joints[i]
        assert data.joint(f"{name}_rotor").qpos == data.joint(name).qpos == robot.standing[i]
        assert data.tendon(f"{name}_gear").length == 0.0


SERVO = [
    {"name": "coulomb_friction", "joint": "pivot", "torque": 0.05},
    {"name": "torque_constant_error", "error": -0.1},
    {"name": "joint_offset", "joint": "pivot", "offset": 0.02},
]  # fmt: skip


def apart(rate, power):
    """Positions of a servo with a long arm here, and minus those in MuJoCo alone [rad]."""
    fine = {"sim.physics_rate": rate, "drives.pivot.resolution": 0.0, "sensors.exact": True}
    model, dt = Model("servo_pendulum", fine, SERVO), 0.01
    told = 0.5 * np.sign(np.sin(2.0 * np.pi * np.arange(0.0, 1.2, dt) + 0.1))[:, None]
    plant = Bolted(model.make_robot(), model.make_effects(), 0, dt)
    mine = plant.run(told, power=power).q
    made, _ = compiled(model, ELASTIC)
    given = {"dt": dt, "finer": 1.0, "ctrl": told, "ramps": 0.0, "power": power,
             "joints": ["pivot"], "q": [0.0], "dq": [0.0]}  # fmt: skip
    return mine, mine - replay_mjcf.play(made, given)


@pytest.mark.parametrize("let_go", [False, True])
def test_a_gear_that_bends_moves_as_here_the_closer_the_finer_the_step(let_go):
    power = np.ones((120, 2))
    power[:, 0] = 0.9
    power[60:, 1] = 1.0 - let_go
    (mine, coarse), (_, middle), (_, fine) = (apart(rate, power) for rate in (1000, 4000, 16000))
    assert np.ptp(mine) > 0.8
    rms = [np.sqrt(np.mean(one**2)) for one in (coarse, middle, fine)]
    assert rms[1] < rms[0] / 3.0 and rms[2] < rms[1] / 3.0  # of first order: 4
    assert rms[2] < 1e-3 * np.ptp(mine)


@pytest.mark.parametrize("name", sorted(EFFECTS))
def test_no_effect_is_lost_without_a_word(name):
    kind = EFFECTS[name]
    robot = "hyq" if kind.applies(Model("hyq").make_robot()) else "tigrillo"
    spec = {"name": name} | ({"channel": "q"} if name == "sensor_stuck" else {})
    for key, prior in kind.identity.priors.items():
        size = max(prior.typical, prior.low, key=abs)
        default = kind.__dataclass_fields__[key].default
        spec[key] = [size] * len(default) if isinstance(default, tuple) else size
    assert not from_list([spec])[0].absent()
    plain, text = (mjcf(portable(Model(robot, {}, e))) for e in ([], [spec]))
    moved = plain[0].split("-->")[1] != text[0].split("-->")[1]
    assert moved or any(name in sentence for sentence in text[1])


def test_urdf_keeps_the_links_and_lists_the_gains():
    text, lost = urdf(portable(Model("hyq", {}, [{"name": "viscous_friction", "damping": 2.0}])))
    description = Description(text.partition("-->")[2])
    assert description.mass() == pytest.approx(Model("hyq").make_robot().mass)
    assert description.damping("lf_hfe_joint") == pytest.approx(2.0 + own("lf_hfe_joint"))
    assert any("kp 250" in sentence for sentence in lost)


@pytest.mark.parametrize(
    ("drive", "sentence"),
    [
        ({"torque": "held", "period": 0.004}, "what its drive asks for is held for 0.004 s"),
        ({"torque": "averaged", "period": 0.01}, "what its drive asks for is averaged for 0.01 s"),
        ({"ki": 30.0}, r"its integrator \(ki 30, speed_ki 0\)"),
        ({"speed_ki": 7.0}, r"its integrator \(ki 0, speed_ki 7\)"),
        ({"speed_feed": 0.5}, "0.5 of the commanded velocity is asked for"),
    ],
)
def test_what_a_drive_does_besides_its_gains_is_told(drive, sentence):
    changes = {f"drives.slide.{key}": value for key, value in drive.items()}
    made = portable(Model("linear_axis", changes))
    for write in (mjcf, urdf):
        lost = write(made)[1]
        assert any(re.search(f"slide.*: {sentence}", each) for each in lost), lost


def test_a_cascade_has_the_stiffness_of_both_loops():
    changes = {"drives.slide.kp": 5.0, "drives.slide.position_gain": 20.0}
    assert portable(Model("linear_axis", changes)).joints[0].kp == 5.0 + 60.0 * 20.0


def own(joint):
    return Description(Model("hyq").make_robot().urdf).damping(joint)


def test_python_for_isaac_and_pace_carries_constants_and_ranges():
    made = portable(Model("tigrillo", {}, [FRICTION, {"name": "command_delay", "delay": 0.02}]))
    known, unused = ranges.of(made, [TERM])
    assert (known[0].constant, known[0].joints, unused) == ("friction", ("lf_hfe_joint",), [])
    for write in (isaac.isaac, isaac.pace):
        text, lost = write(made, known)
        names = {node.id for node in ast.walk(ast.parse(text)) if isinstance(node, ast.Name)}
        assert {"DCMotorCfg", "PaceDCMotorCfg"} & names
        assert all(f"#   - {sentence}\n" in text for sentence in lost)
    assert '"friction_distribution_params": (0.04, 0.07)' in isaac.isaac(made, known)[0]
    assert "[0.04, 0.07]" in isaac.pace(made, known)[0]
    assert "max_delay=20" in isaac.pace(made, known)[0]


@pytest.mark.parametrize("gear", [RIGID, ELASTIC])
def test_ranges_name_the_places_of_the_compiled_model(gear):
    terms = [TERM, {**TERM, "effect": "torque_constant_error", "place": "",
                    "parameters": {"error": {**TERM["parameters"]["torque"], "value": 0.0}}},
             {**TERM, "effect": "slip"}]  # fmt: skip
    model = Model("tigrillo", {}, [FRICTION])
    made, _ = compiled(model, gear)
    known, unused = ranges.of(portable(model, gear), terms)
    assert len(known) == 2 and "slip" in unused[0]
    there = dofs(mjcf(portable(model, gear))[0])
    tree = ast.parse(ranges.playground(portable(model, gear), known, there)[0])
    table = next(n.value for n in tree.body if isinstance(n, ast.Assign))
    for one, (low, high, targets) in zip(known, ast.literal_eval(table), strict=True):
        assert (low, high) == (one.low, one.high)
        for field, index, a, b in targets:  # at the estimate the model is what was exported
            assert getattr(made, field)[index] == pytest.approx(a + b * one.value)
