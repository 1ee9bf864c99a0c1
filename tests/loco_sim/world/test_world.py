# SPDX-License-Identifier: Apache-2.0
"""The world obeys mechanics, agrees with the controllers' kinematics and is reproducible."""

import dataclasses
from contextlib import closing

import numpy as np
import pytest
import trimesh
from tests.quadrupeds import joint_limits

from loco_control.exceptions import NameUnknownError, ParameterError
from loco_control.legs.kinematics import foot_position
from loco_sim.engines import ENGINES, installed
from loco_sim.geometry import rotate_back, rotation_matrix
from loco_sim.meshes.read import READERS
from loco_sim.params import SimParams
from loco_sim.robot import robot
from loco_sim.world.world import make_world

MASS, GRAVITY = 84.756, 9.81
PENDULUM = """<robot name="bench"><link name="stand"><inertial><mass value="1"/>
<inertia ixx="1" iyy="1" izz="1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<link name="rod"><inertial><origin xyz="0 0 -0.5"/><mass value="2"/>
<inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="pivot" type="continuous"><parent link="stand"/><child link="rod"/>
<axis xyz="0 1 0"/></joint></robot>"""


def bench(folder, engine, urdf=PENDULUM, base="fixed_base: true"):
    """World of a bench, not built yet."""
    (folder / "bench.urdf").write_text(urdf)
    (folder / "robot.yaml").write_text(f"urdf: bench.urdf\njoints: [pivot]\n{base}\nheight: 2.0\n")
    return make_world(robot.load(folder), SimParams(engine=engine), 0.0005)


def colliding(origin, shape):
    """The pendulum with a shape on its rod that collides, at a height in its frame."""
    part = f"""<collision><origin xyz="0 0 {origin}"/><geometry>{shape}</geometry></collision>"""
    return PENDULUM.replace("</link>\n<joint", f"{part}</link>\n<joint")


@pytest.fixture
def pendulum(tmp_path, engine):
    """A physical pendulum bolted to the world: no feet, no trunk, one joint."""
    with closing(bench(tmp_path, engine)) as made:
        made.rebuild([0.1], height=2.0)
        yield made


@pytest.mark.parametrize("suffix", READERS)
def test_every_kind_of_mesh_has_its_place_and_scale(tmp_path, engine, suffix):
    corners = trimesh.creation.box(bounds=[[0.0, 0.0, -3.0], [1.0, 2.0, 0.5]])
    corners.export(tmp_path / f"part{suffix}")
    urdf = colliding(-0.25, f'<mesh filename="part{suffix}" scale="0.1 0.1 0.5"/>')
    around = 1e-3 if engine == "pybullet" else 0.0  # what PyBullet puts around meshes [m]
    with closing(bench(tmp_path, engine, urdf)) as made:
        made.rebuild([0.0], height=4.0)
        lowest = made.lowest_points()["rod"][2]
        assert lowest == pytest.approx(4.0 - 0.25 - 0.5 * 3.0 - around, abs=1e-6)


@pytest.mark.parametrize("middle", [0.0, -0.3, 0.02])
def test_a_round_foot_begins_on_the_ground_wherever_it_is_on_its_link(tmp_path, engine, middle):
    urdf = colliding(middle, '<sphere radius="0.1"/>')
    with closing(bench(tmp_path, engine, urdf, base="feet: [rod]")) as made:
        made.rebuild([0.0])
        assert made.base().position[2] == pytest.approx(0.1 - middle, abs=1e-4)


def test_more_links_than_an_engine_has_room_for_are_one_line(tmp_path, engine):
    link = PENDULUM[PENDULUM.index('<link name="rod">') : PENDULUM.index("<joint")]
    more = "".join(
        link.replace("rod", f"part{i}")
        + f'<joint name="fix{i}" type="fixed"><parent link="stand"/><child link="part{i}"/></joint>'
        for i in range(250)
    )
    urdf = PENDULUM.replace('<joint name="pivot"', more + '<joint name="pivot"')
    with closing(bench(tmp_path, engine, urdf)) as made:
        if engine == "mujoco":
            made.rebuild([0.1], height=2.0)
            assert made.joint_states()[0][0] == pytest.approx(0.1)
        else:
            with pytest.raises(ParameterError, match="251 links.*--engine mujoco"):
                made.rebuild([0.1], height=2.0)


def in_the_air(world, hyq, height=5.0):
    world.rebuild(hyq.standing, height=height)
    return world


def holding(world, hyq):
    """Torques that hold the standing pose [N·m]."""
    return [
        400.0 * (wanted - q) - 8.0 * dq
        for wanted, q, dq in zip(hyq.standing, *world.joint_states(), strict=True)
    ]


def test_feet_are_where_the_controllers_think_they_are(world, hyq):
    low, high = joint_limits()
    rng = np.random.default_rng(2)
    for _ in range(20):
        q = rng.uniform(low, high)
        turn = rng.standard_normal(4)
        turn /= np.linalg.norm(turn)
        world.pose((0.4, -0.2, 1.5), turn, q)
        base = world.base()
        matrix = rotation_matrix(base.orientation)
        seen = [
            rotate_back(matrix, np.subtract(world.place(foot), base.position)) for foot in hyq.feet
        ]
        np.testing.assert_allclose(seen, foot_position(q), atol=1e-12)


def test_the_base_pose_is_that_of_the_urdf_frame_not_of_the_centre_of_mass(world, hyq):
    turn = np.array([0.1, -0.2, 0.3, 0.5])
    turn /= np.linalg.norm(turn)
    world.pose((0.1, 0.2, 0.9), turn, hyq.standing)
    base = world.base()
    np.testing.assert_allclose(base.position, (0.1, 0.2, 0.9), atol=1e-12)
    np.testing.assert_allclose(base.orientation, turn, atol=1e-12)


def test_the_robot_starts_level_with_its_lowest_foot_on_the_ground(world, hyq):
    lowest = min(world.place(foot)[2] for foot in hyq.feet)
    assert lowest == pytest.approx(0.02175, abs=1e-9)
    np.testing.assert_allclose(world.base().orientation, [0, 0, 0, 1], atol=1e-12)


def test_in_the_air_it_falls_with_gravity(world, hyq):
    in_the_air(world, hyq)
    start, steps = world.base().position[2], 200
    for _ in range(steps):
        world.step([0.0] * 12)
    t = steps * world.dt
    fallen = start - world.base().position[2]
    assert fallen == pytest.approx(0.5 * GRAVITY * t * t, rel=0.01)


def test_a_push_gives_the_momentum_of_its_impulse(world, hyq):
    in_the_air(world, hyq)
    for _ in range(20):
        world.push((0.0, 50.0, 0.0))
        world.step([0.0] * 12)
    # Legs hang loose, so the base moves more than the whole: compare with the centre of mass.
    before = centre_of_mass(world, hyq)
    for _ in range(50):
        world.step([0.0] * 12)
    speed = (centre_of_mass(world, hyq) - before) / (50 * world.dt)
    assert speed[1] == pytest.approx(50.0 * 20 * world.dt / MASS, rel=0.02)
    assert speed[0] == pytest.approx(0.0, abs=1e-4)


def centre_of_mass(world, hyq):
    import xml.etree.ElementTree as ET

    total, where = 0.0, np.zeros(3)
    for link in ET.fromstring(hyq.urdf).findall("link"):
        mass = float(link.find("inertial/mass").get("value"))
        com = [float(v) for v in link.find("inertial/origin").get("xyz").split()]
        where += mass * np.array(world.place(link.get("name"), com))
        total += mass
    return where / total


def test_a_push_off_centre_turns_the_robot(world, hyq):
    in_the_air(world, hyq)
    for _ in range(20):
        world.push((0.0, 0.0, 100.0), point=(0.0, 0.3, 0.0))
        world.step([0.0] * 12)
    assert world.base().angular_velocity[0] > 0.05


def test_a_link_can_be_pushed_as_well(world, hyq):
    in_the_air(world, hyq)
    before = world.joint_states()[1][1]
    for _ in range(5):
        world.push((100.0, 0.0, 0.0), link="lf_foot")
        world.step([0.0] * 12)
    assert world.joint_states()[1][1] != before
    assert abs(world.joint_states()[1][1]) > abs(world.joint_states()[1][10])


@pytest.mark.parametrize("push", [(0.0, 0.0, 0.0), (50.0, 0.0, 0.0), (0.0, -50.0, 100.0)])
def test_the_ground_carries_the_weight_and_withstands_a_push(world, hyq, push):
    mean = np.zeros(12)
    for k in range(1500):
        world.push(push)
        world.step(holding(world, hyq))
        if k >= 1000:
            force = [0.0] * 12
            world.add_ground_forces(force)
            mean += np.array(force) / 500
    total = mean.reshape(4, 3).sum(axis=0)
    np.testing.assert_allclose(total, np.subtract([0, 0, MASS * GRAVITY], push), atol=12.0)


def test_a_slippery_foot_slides(hyq, engine):
    def slip(friction):
        made = make_world(hyq, SimParams(engine=engine), 0.001)
        made.rebuild(hyq.standing, [lambda w: w.friction.update(dict.fromkeys(hyq.feet, friction))])
        for _ in range(300):
            made.push((60.0, 0.0, 0.0))
            made.step(holding(made, hyq))
        moved = made.place("lf_foot")[0]
        made.close()
        return moved

    assert slip(0.01) > slip(1.0) + 0.02


def test_a_soft_contact_sinks_in(hyq, engine):
    def depth(**contact):
        made = make_world(hyq, SimParams(engine=engine, **contact), 0.001)
        made.rebuild(hyq.standing)
        lowest = []
        for _ in range(400):
            made.step(holding(made, hyq))
            lowest.append(made.place("lf_foot")[2])
        made.close()
        return 0.02175 - lowest[-1]

    assert depth(contact_stiffness=2e4) > depth() + 0.003


def test_soft_ground_gives_way_downwards_and_holds_a_foot_sideways(hyq, engine):
    """A push that friction withstands tilts the robot and moves no foot that it loads less."""

    def crept(**contact):
        made = make_world(hyq, SimParams(engine=engine, **contact), 0.001)
        made.rebuild(hyq.standing)
        at = []
        for _ in range(600):
            made.push((150.0, 0.0, 0.0))
            made.step(holding(made, hyq))
            at.append(made.place("lf_foot")[0])
        made.close()
        return at[-1] - at[300]

    assert abs(crept()) < 1e-3
    assert abs(crept(contact_stiffness=3e4, contact_damping=500.0)) < 1e-3


def test_a_pendulum_swings_with_its_own_period(pendulum):
    inertia = pendulum.joint_inertia([0.0])
    assert inertia == pytest.approx(np.array([[0.1 + 2.0 * 0.25]]))
    period = 2.0 * np.pi * np.sqrt(inertia[0, 0] / (2.0 * GRAVITY * 0.5))
    speeds = []
    for _ in range(8000):
        pendulum.step([0.0])
        speeds.append(pendulum.joint_states()[1][0])
    speeds = np.array(speeds)
    rising = np.flatnonzero((speeds[:-1] < 0) & (speeds[1:] >= 0)) * pendulum.dt
    assert np.diff(rising).mean() == pytest.approx(period, rel=0.01)


def test_the_joint_inertia_predicts_what_a_torque_does(hyq, engine):
    """Dq = I^-1 tau dt for a robot afloat without gravity, its base moving as it must."""
    afloat = make_world(hyq, SimParams(engine=engine, gravity=0.0), 1e-4)
    undamped = [lambda w: [w.description.set_damping(joint, 0.0) for joint in hyq.joints]]
    afloat.rebuild(hyq.standing, undamped, height=2.0)
    inertia = afloat.joint_inertia(hyq.standing)
    tau = np.random.default_rng(6).uniform(-20.0, 20.0, 12)
    afloat.step(tau.tolist())
    dq = list(afloat.joint_states()[1])
    afloat.close()
    np.testing.assert_allclose(dq, np.linalg.solve(inertia, tau) * 1e-4, rtol=1e-3)


def test_a_joint_feels_less_inertia_when_the_base_gives_way(world, hyq, engine):
    bolted = make_world(dataclasses.replace(hyq, fixed_base=True), SimParams(engine=engine), 0.001)
    bolted.rebuild(hyq.standing)
    less = bolted.joint_inertia(hyq.standing) - world.joint_inertia(hyq.standing)
    assert np.linalg.eigvalsh(less)[0] > -1e-9
    shank = bolted.joint_inertia(hyq.standing)[2, 2]
    bolted.close()
    assert shank == pytest.approx(0.0262, abs=1e-4)  # from the masses and lengths of a shank


def test_the_base_velocity_is_that_of_the_base_origin(world, hyq):
    def load(w):  # far from the origin, so that the centre of mass moves otherwise
        w.description.add_mass("base_link", 80.0, (0.4, 0.3, 0.2))

    world.rebuild(hyq.standing, [load], height=5.0)
    for _ in range(30):
        world.push((100.0, -200.0, 300.0), point=(-0.3, -0.2, 0.1))
        world.step([0.0] * 12)
    before = world.base()
    world.step([0.0] * 12)
    after = world.base()
    moved = np.subtract(after.position, before.position) / world.dt
    mean = 0.5 * np.add(after.velocity, before.velocity)
    assert np.linalg.norm(after.angular_velocity) > 0.1
    np.testing.assert_allclose(moved, mean, atol=0.01)


def test_a_rebuilt_world_repeats_itself_bit_for_bit(world, hyq):
    def motion():
        world.rebuild(hyq.standing)
        seen = []
        for k in range(200):
            world.step([5.0 * np.sin(0.1 * k)] * 12)
            seen.append((world.joint_states(), world.base()))
        return seen

    assert motion() == motion()


def test_two_worlds_do_not_disturb_each_other(world, hyq, engine):
    other = make_world(hyq, SimParams(engine=engine), 0.001)
    other.rebuild(hyq.standing, height=3.0)
    before = world.base()
    for _ in range(10):
        other.step([1.0] * 12)
    assert world.base() == before
    other.close()
    other.close()  # closing twice is harmless
    assert world.base() == before


# --- two engines behind one face ---------------------------------------------------


@pytest.mark.pybullet
def test_the_engines_agree_where_nothing_touches(hyq):
    """A swinging robot in the air: the same motion, but for the order of integration."""
    seen = {}
    for engine in ENGINES:
        made = make_world(hyq, SimParams(engine=engine), 0.001)
        made.rebuild(hyq.standing, height=5.0)
        for k in range(500):
            made.step((20.0 * np.sin(0.02 * k) * np.tile([0.2, 1.0, -0.5], 4)).tolist())
        seen[engine] = np.array(made.joint_states()[0]), np.array(made.base().position)
        made.close()
    moved = np.abs(seen["pybullet"][0] - hyq.standing).max()
    assert moved > 0.5
    np.testing.assert_allclose(seen["mujoco"][0], seen["pybullet"][0], atol=0.02 * moved)
    np.testing.assert_allclose(seen["mujoco"][1], seen["pybullet"][1], atol=0.01)


def test_a_soft_contact_is_a_spring_of_its_stiffness(hyq, engine):
    """Weight over stiffness is the depth of a standing foot, on both engines."""
    stiffness = 2e4
    made = make_world(hyq, SimParams(engine=engine, contact_stiffness=stiffness), 0.001)
    made.rebuild(hyq.standing)
    for _ in range(1500):
        made.step(holding(made, hyq))
    depth = sum(0.02175 - made.place(foot)[2] for foot in hyq.feet)
    made.close()
    assert depth == pytest.approx(MASS * GRAVITY / stiffness, rel=0.02)


@pytest.fixture
def packages(monkeypatch):
    """Function that makes only some engines look installed."""

    def only(*names):
        monkeypatch.setattr("importlib.util.find_spec", lambda name: name in names or None)
        installed.cache_clear()

    yield only
    monkeypatch.undo()
    installed.cache_clear()


def test_an_engine_that_is_unknown_or_not_there_is_named(hyq, packages):
    with pytest.raises(NameUnknownError, match="engine.*drake.*available: mujoco, pybullet"):
        SimParams(engine="drake")
    packages("pybullet")
    with pytest.raises(ParameterError, match="'mujoco', which is not installed; .*: pybullet"):
        make_world(hyq, SimParams(engine="mujoco"), 0.001)


def test_what_an_engine_cannot_do_is_said_before_it_is_loaded():
    with pytest.raises(ParameterError, match="sim.restitution is 0.3, .*MuJoCo.*--engine pybullet"):
        SimParams(engine="mujoco", restitution=0.3)


def test_a_joint_leans_on_its_stop_and_hardly_sinks_in(engine):
    """A carriage that is pushed against the end of its rail."""
    bench = robot.load("linear_axis")
    made = make_world(bench, SimParams(engine=engine), 0.001)
    made.rebuild([0.3])
    for _ in range(1000):
        made.step([20.0])
    (q,), (dq,) = made.joint_states()
    made.close()
    assert q == pytest.approx(0.4, abs=1e-4)
    assert abs(dq) < 1e-6


@pytest.mark.pybullet
def test_the_default_engine_is_pybullet_where_it_is_there(monkeypatch, packages):
    assert SimParams().engine == "pybullet"
    packages("mujoco")
    assert SimParams().engine == "mujoco"
    monkeypatch.setenv("LOCO_ENGINE", "pybullet")
    assert SimParams().engine == "pybullet"


def test_a_shape_that_mujoco_cannot_build_is_one_line(tmp_path):
    text = PENDULUM.replace('<mass value="2"/>', '<mass value="0"/>').replace(
        'ixx="0.1" iyy="0.1" izz="0.1"', 'ixx="0" iyy="0" izz="0"'
    )
    bad = dataclasses.replace(robot.load("pendulum"), urdf=text, joints=("pivot",), folder=tmp_path)
    with pytest.raises(ParameterError, match="MuJoCo cannot build robot 'pendulum'"):
        make_world(bad, SimParams(engine="mujoco"), 0.001).rebuild([0.0])


def test_a_link_may_be_called_world(tmp_path, engine):
    """Many arms have one, and MuJoCo calls its own ground so."""
    inertia = "".join(
        f'{axis}="{int(axis[1] == axis[2])}" ' for axis in "ixx iyy izz ixy ixz iyz".split()
    )
    inertial = f'<inertial><mass value="1"/><inertia {inertia}/></inertial>'
    (tmp_path / "arm.urdf").write_text(
        f'<robot name="r"><link name="world"/><link name="arm">{inertial}</link>'
        '<joint name="j" type="continuous"><parent link="world"/><child link="arm"/>'
        '<axis xyz="0 1 0"/></joint></robot>'
    )
    (tmp_path / "robot.yaml").write_text("urdf: arm.urdf\njoints: [j]\nfixed_base: true\n")
    loaded = robot.load(tmp_path)
    made = make_world(loaded, loaded.sim.replace(engine=engine), 0.001)
    made.rebuild((0.5,), height=1.0)
    for _ in range(100):
        made.step([1.0])
    q, dq = made.joint_states()
    assert dq[0] == pytest.approx(0.1, rel=1e-6)  # 1 N·m on 1 kg·m² for 0.1 s
    made.close()
