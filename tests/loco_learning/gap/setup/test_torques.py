# SPDX-License-Identifier: Apache-2.0
"""Mistakes of torques are told by inverse dynamics, on a robot of loco's and one made here."""

import shutil
from functools import cache
from pathlib import Path

import numpy as np
import pytest
import yaml

import loco_sim
from loco_learning.gap.recordings.record import Record
from loco_learning.gap.setup import family, torques
from loco_sim.bolted.loop import Bolted
from loco_sim.effects import from_list
from loco_sim.plant.model import Model

from .conftest import read

ASSETS = Path(loco_sim.__file__).parent / "assets"
DT, SECONDS = 0.004, 5.0
LINK = (
    '<link name="{name}"><inertial><origin xyz="0.01 0.02 {half}"/><mass value="{mass}"/>'
    '<inertia ixx="{i}" iyy="{i}" izz="{i}" ixy="0" ixz="0" iyz="0"/></inertial></link>'
)
JOINT = (
    '<joint name="{name}" type="revolute"><parent link="{parent}"/><child link="{name}_link"/>'
    '<origin xyz="0 0 {at}"/><axis xyz="{axis}"/>'
    '<limit lower="-3" upper="3" effort="300" velocity="10"/></joint>'
)
ARM = {  # axis, length of the link before [m], mass [kg], kp, kd, standing [rad]
    "turn": ("0 0 1", 0.1, 3.0, 300.0, 20.0, 0.0),
    "lift": ("0 1 0", 0.1, 2.5, 900.0, 60.0, 0.7),
    "bend": ("0 1 0", 0.4, 1.5, 500.0, 25.0, 0.9),
    "roll": ("0 0 1", 0.3, 0.5, 60.0, 1.5, 0.2),
    "nod": ("1 0 0", 0.1, 0.5, 60.0, 1.5, 0.4),
}


def urdf():
    """A robot of five joints."""
    parts, parent = ['<link name="base"/>'], "base"
    for name, (axis, at, mass, *_) in ARM.items():
        parts.append(LINK.format(name=f"{name}_link", half=0.15, mass=mass, i=0.02 * mass))
        parts.append(JOINT.format(name=name, parent=parent, at=at, axis=axis))
        parent = f"{name}_link"
    return f'<robot name="made">{"".join(parts)}</robot>'


def arm(folder):
    drives = {j: {"kind": "impedance", "kp": v[3], "kd": v[4]} for j, v in ARM.items()}
    values = {
        "urdf": "made.urdf",
        "fixed_base": True,
        "height": 1.0,
        "joints": list(ARM),
        "control_rate": 250,
        "drives": drives,
        "standing": [v[5] for v in ARM.values()],
    }
    (folder / "made.urdf").write_text(urdf())
    (folder / "robot.yaml").write_text(yaml.safe_dump(values))


def leg(folder):
    shutil.copytree(ASSETS / "hyq_leg", folder, dirs_exist_ok=True)


ROBOTS = {"arm": arm, "leg": leg}


@pytest.fixture(scope="session")
def robots(tmp_path_factory):
    """Folder of each robot."""
    folders = {name: tmp_path_factory.mktemp(name) for name in ROBOTS}
    for name, write in ROBOTS.items():
        write(folders[name])
    return folders


RUBBING = (
    {"name": "coulomb_friction", "joint": "*", "torque": 0.5},
    {"name": "viscous_friction", "joint": "*", "damping": 0.3},
)


@pytest.mark.parametrize(
    ("constant", "told"), [(0.0, True), (1.0, True), (20.0, False), (-1e3, False)]
)
def test_a_torque_that_hardly_varies_tells_nothing_of_motion(constant, told):
    """Its sign is that of the constant, which motion does not tell; the rest is the drive's."""
    cause = np.sin(0.1 * np.arange(400.0))
    by, error = torques.explained(cause[:, None], constant + 0.9 * cause)
    assert (error < 0.1) if told else (error == 1.0 and not by.any())


@cache
def measured(folder, effects, seed=3):
    """Columns of a recording of a robot with effects."""
    robot = Model(str(folder / "robot.yaml")).make_robot()
    rng, n = np.random.default_rng(seed), len(robot.joints)
    t = DT * np.arange(round(SECONDS / DT))
    f, p = rng.uniform(0.1, 0.7, (n, 4)), rng.uniform(0.0, 6.0, (n, 4))
    wave = np.sum(np.sin(2.0 * np.pi * f * t[:, None, None] + p) - np.sin(p), axis=2)
    told = robot.standing + 0.2 * wave * np.minimum(1.0, t)[:, None]
    made = from_list([dict(one) for one in effects])
    run = Bolted(robot, made, 0, DT).run(told)
    rows = {"t": t}
    for i, joint in enumerate(robot.joints):
        rows[f"q_{joint}"] = run.q[:, i] + 1e-5 * rng.normal(size=len(t))
        rows[f"tau_{joint}"] = run.tau[:, i] + 0.05 * rng.normal(size=len(t))
        rows[f"cmd_{joint}"] = told[:, i]
    return rows


ROLES = {"q": "q", "tau": "tau", "cmd": "command_position"}
ALL, UNMEASURED, PASSED = ("q", "tau", "cmd"), ("q", "cmd"), ("q", "tau")


@pytest.fixture
def judged(robots, tmp_path):
    """Function that records a robot with effects and a mistake, and looks at its set-up.

    Without commands, torques are what the drives were told.
    """

    def make(name, effects=RUBBING, change=None, kinds=ALL):
        folder = shutil.copytree(robots[name], tmp_path / "set")
        rows = dict(measured(robots[name], tuple(tuple(e.items()) for e in effects)))
        if change:
            change(rows)
        text = ",".join(rows)
        np.savetxt(folder / "run.csv", np.stack(list(rows.values()), axis=1), "%.7g", ",",
                   header=text, comments="")  # fmt: skip
        roles = {**ROLES, "tau": "command_torque"} if kinds == PASSED else ROLES
        columns = [{"column": c, "role": roles[c.partition("_")[0]], "joint": c.partition("_")[2]}
                   for c in rows if c.partition("_")[0] in kinds]  # fmt: skip
        if kinds == PASSED:
            values = yaml.safe_load((folder / "robot.yaml").read_text())
            values["drives"] = {joint: {"kind": "torque"} for joint in values["joints"]}
            (folder / "robot.yaml").write_text(yaml.safe_dump(values))
        mapping = {"files": "*.csv", "time": {"column": "t"}, "columns": columns}
        (folder / "mapping.yaml").write_text(yaml.safe_dump(mapping))
        return family.find_mistakes(*read(folder))

    return make


EFFECTS = {
    "none": (),
    "rough": (
        {"name": "coulomb_friction", "joint": "*", "torque": 4.0},
        {"name": "viscous_friction", "joint": "*", "damping": 3.0},
    ),
    "friction": RUBBING,
    "payload": (*RUBBING, {"name": "payload", "mass": 1.0}),
    "slope": (*RUBBING, {"name": "slope", "pitch": 0.05, "roll": -0.04}),
    "bias": (*RUBBING, {"name": "torque_bias", "joint": "*", "torque": 1.0}),
}


@pytest.mark.parametrize(
    ("name", "effects", "kinds"),
    [
        *(("arm", name, ALL) for name in EFFECTS),
        ("arm", "payload", UNMEASURED), ("arm", "payload", PASSED), ("arm", "rough", PASSED),
        ("leg", "rough", ALL), ("leg", "bias", ALL), ("leg", "payload", UNMEASURED),
        ("leg", "payload", PASSED),
    ],
)  # fmt: skip
def test_physical_effects_are_no_mistake_of_the_set_up(judged, name, effects, kinds):
    assert judged(name, EFFECTS[effects], kinds=kinds) == []


TILTED = {"pitch": -0.2, "roll": 0.2}


@pytest.mark.parametrize(
    ("name", "tilt", "kinds"),
    [
        ("arm", {"pitch": 0.14}, ALL), ("arm", {"roll": -0.25}, UNMEASURED), ("arm", TILTED, ALL),
        ("leg", {"pitch": 0.2}, ALL), ("leg", TILTED, UNMEASURED),
    ],
)  # fmt: skip
def test_the_angle_of_a_bench_follows_from_the_torques(judged, mended, name, tilt, kinds):
    found = judged(name, (*RUBBING, {"name": "slope", **tilt}), kinds=kinds)
    (finding,) = found
    assert finding.fault == "gravity turned" and finding.stops and not finding.others
    (spec,) = finding.mends[0].value
    for key in ("pitch", "roll"):
        assert spec[key] == pytest.approx(tilt.get(key, 0.0), abs=0.02)
    if tilt is TILTED:
        assert family.find_mistakes(*mended(found)) == []


def times(factor, *columns):
    def change(rows):
        for column in columns:
            rows[column] = factor * rows[column]

    return change


def ring(*columns):
    """Each of some columns given to the next."""

    def change(rows):
        values = [rows[column] for column in columns]
        for column, value in zip((*columns[1:], columns[0]), values, strict=True):
            rows[column] = value

    return change


def exchange_names(a, b):
    """All columns of a joint given to another and the reverse."""

    def change(rows):
        for kind in ALL:
            ring(f"{kind}_{a}", f"{kind}_{b}")(rows)

    return change


@pytest.mark.parametrize(
    ("name", "pair", "kinds"),
    [
        ("arm", ("turn", "lift"), ALL), ("arm", ("lift", "bend"), ALL),
        ("arm", ("bend", "nod"), ALL), ("arm", ("lift", "roll"), PASSED),
        ("leg", ("lf_haa_joint", "lf_hfe_joint"), ALL),
        ("leg", ("lf_haa_joint", "lf_kfe_joint"), ALL),
        ("leg", ("lf_hfe_joint", "lf_kfe_joint"), PASSED),
    ],
)  # fmt: skip
def test_names_exchanged_in_all_columns_are_told_by_the_bodies(judged, mended, name, pair, kinds):
    found = judged(name, change=exchange_names(*pair), kinds=kinds)
    assert [(f.fault, set(f.joints)) for f in found] == [("exchanged", set(pair))], [
        *map(str, found)
    ]
    assert {(c.joint, c.value) for c in found[0].mends} == {pair, pair[::-1]}
    assert len({c.role for c in found[0].mends}) >= 2 and not found[0].others
    assert family.find_mistakes(*mended(found)) == []


def test_exchanged_names_without_torques_or_of_alike_bodies_are_not_told(judged):
    """Two joints that follow their own commands: nothing in such a recording tells them apart."""
    change = exchange_names("lift", "bend")
    assert "exchanged" not in {f.fault for f in judged("arm", change=change, kinds=UNMEASURED)}


@pytest.mark.parametrize(
    ("name", "joint", "kinds", "offset"),
    [("arm", "lift", ALL, 1.2), ("arm", "bend", PASSED, -0.9), ("arm", "lift", PASSED, 1.571),
     ("leg", "lf_hfe_joint", PASSED, 1.2)],
)  # fmt: skip
def test_another_zero_of_an_angle_is_told_by_the_weight(judged, mended, name, joint, kinds, offset):
    def change(rows):
        for column in (f"q_{joint}", f"cmd_{joint}"):
            rows[column] = rows[column] + offset

    found = judged(name, change=change, kinds=kinds)
    assert [(f.fault, f.joints) for f in found] == [("zero", (joint,))], [*map(str, found)]
    assert not found[0].others
    assert {c.role for c in found[0].mends} == {"q", "command_position"} & {ROLES[k] for k in kinds}
    assert [c.value for c in found[0].mends] == pytest.approx(
        [-offset] * len(found[0].mends), abs=0.1
    )
    assert family.find_mistakes(*mended(found)) == []


@pytest.mark.parametrize(("joint", "offset"), [("lift", 1.571), ("bend", -0.9)])
def test_another_zero_of_a_measured_angle_alone_is_not_that_of_its_command(
    judged, mended, joint, offset
):
    def change(rows):
        rows[f"q_{joint}"] = rows[f"q_{joint}"] + offset

    (finding,) = judged("arm", change=change, kinds=ALL)
    assert [(c.role, c.joint) for c in finding.mends] == [("q", joint)], str(finding)
    assert finding.mends[0].value == pytest.approx(-offset, abs=0.1)
    assert family.find_mistakes(*mended([finding])) == []


@pytest.mark.parametrize("kinds", [ALL, PASSED])
def test_an_angle_from_the_base_is_told_by_the_weight(judged, kinds):
    def change(rows):
        for kind in ("q", "cmd"):
            rows[f"{kind}_bend"] = rows[f"{kind}_bend"] + rows[f"{kind}_lift"]

    (finding,) = judged("arm", change=change, kinds=kinds)
    assert (finding.fault, finding.joints, finding.mends) == ("zero", ("bend",), ())
    assert "if q of bend is an angle from the link before lift" in str(finding)


HIPS = "tau_lf_haa_joint", "tau_lf_hfe_joint", "tau_lf_kfe_joint"
PLANTED = [
    ("arm", ring("tau_lift", "tau_bend"), {"exchanged"}, {"lift", "bend"}),
    ("arm", ring("tau_turn", "tau_roll"), {"exchanged"}, {"turn", "roll"}),
    ("arm", ring("tau_lift", "tau_bend", "tau_nod"), {"exchanged"}, {"lift", "bend", "nod"}),
    ("arm", times(-1.0, "tau_roll"), {"sign"}, {"roll"}),
    ("arm", times(-1.0, "tau_lift", "tau_nod"), {"sign"}, {"lift", "nod"}),
    ("arm", times(1e3, "tau_bend"), {"effort"}, {"bend"}),
    ("arm", times(100.0, "tau_nod"), {"effort"}, {"nod"}),
    ("arm", times(1e-3, "tau_turn"), {"effort"}, {"turn"}),
    ("leg", ring(*HIPS[:2]), {"exchanged"}, {"lf_haa_joint", "lf_hfe_joint"}),
    ("leg", ring(*HIPS), {"exchanged"}, {"lf_haa_joint", "lf_hfe_joint", "lf_kfe_joint"}),
    ("leg", times(-1.0, HIPS[0]), {"sign"}, {"lf_haa_joint"}),
    ("leg", times(1e3, HIPS[2]), {"effort"}, {"lf_kfe_joint"}),
    ("leg", times(100.0, HIPS[1]), {"effort"}, {"lf_hfe_joint"}),
]


@pytest.mark.parametrize(
    ("name", "change", "faults", "joints", "kinds"),
    [
        *((*row, ALL) for row in PLANTED),
        *((*row, PASSED) for row in (*PLANTED[2:9:3], PLANTED[-1])),
    ],
)
def test_columns_of_torques_are_told_by_what_the_motion_needs(
    judged, mended, robots, name, change, faults, joints, kinds
):
    """The lines restore the torques, in which nothing is found: see the friction above."""
    found = judged(name, change=change, kinds=kinds)
    assert {finding.fault for finding in found} == faults, list(map(str, found))
    assert {joint for finding in found for joint in finding.joints} == joints
    role = "command_torque" if kinds == PASSED else "tau"
    lines = [change for finding in found for change in finding.mends]
    assert {(c.role, c.joint) for c in lines} == {(role, joint) for joint in joints}
    assert not any(finding.others for finding in found)
    (record,), names = mended(found)[1], Model(str(robots[name] / "robot.yaml")).make_robot().joints
    clean = measured(robots[name], tuple(tuple(e.items()) for e in RUBBING))
    torques_of = record.command["torque"] if kinds == PASSED else record.signals["tau"]
    clean_torques = np.stack([clean[f"tau_{joint}"] for joint in names], axis=1)
    np.testing.assert_allclose(torques_of, clean_torques, rtol=1e-5, atol=1e-5)


AXIS = """<robot name="blade"><link name="base"/><link name="blade">
  <inertial><mass value="40"/><inertia ixx="12" iyy="12" izz="{}" ixy="0" ixz="0" iyz="0"/></inertial></link>
  <joint name="turn" type="continuous"><parent link="base"/><child link="blade"/><axis xyz="0 0 1"/></joint>
</robot>"""


@pytest.mark.parametrize("constant", [0.2, 12.0, 60.0])  # N·m per A
def test_currents_tell_no_unit_of_a_motion_by_the_integrator_of_its_drive(tmp_path, constant):
    """A PI loop of velocities: a motion in degrees needs as much less torque as a current is."""
    inertia, gain, integral, dt = 20.0, 150.0, 900.0, 0.01
    (tmp_path / "blade.urdf").write_text(AXIS.format(inertia))
    drive = f"{{kind: impedance, kd: {gain}, speed_ki: {integral}}}"
    (tmp_path / "robot.yaml").write_text(
        "urdf: blade.urdf\njoints: [turn]\nfixed_base: true\nheight: 0.0\ncontrol_rate: 100\n"
        f"drives: {{turn: {drive}}}\n"
    )
    records = []
    for seed in range(2):
        rng = np.random.default_rng(seed)
        q, dq, z, rows = 0.1, 0.0, 0.0, []
        rate, size = rng.uniform(0.2, 1.5, 4) * 2.0 * np.pi, rng.uniform(0.02, 0.05, 4)
        for k in range(800):
            told = float(size @ np.sin(rate * dt * k))
            rows.append((told, q, gain * (told - dq) + z))
            for _ in range(100):
                z += 0.01 * dt * integral * (told - dq)
                dq += 0.01 * dt * (gain * (told - dq) + z) / inertia
                q += 0.01 * dt * dq
        told, q, tau = np.array(rows).T
        signals = {
            "q": (q + rng.normal(0.0, 3e-5, len(q)))[:, None],
            "tau": tau[:, None] / constant,
        }
        records.append(Record(f"r{seed}", dt * np.arange(len(q)), {"velocity": told[:, None]},
                              ("turn",), signals, ("turn",)))  # fmt: skip
    found = family.find_mistakes(Model(str(tmp_path)), records)
    assert {finding.fault for finding in found} <= {"effort"}
    if constant > 3.0:
        (line,) = found[0].mends
        assert line.role == "tau" and line.value == pytest.approx(constant, rel=0.1)
