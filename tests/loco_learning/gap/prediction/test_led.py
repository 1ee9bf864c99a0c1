# SPDX-License-Identifier: Apache-2.0
"""Led along its own motion a model needs the torque it was told; what it lacks is what is more."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.ndimage import gaussian_filter1d

from loco_learning.gap.hypotheses import hints
from loco_learning.gap.hypotheses.hypotheses import offer
from loco_learning.gap.prediction import case as cases
from loco_learning.gap.prediction import led
from loco_learning.gap.prediction.forward import Forward
from loco_learning.gap.recordings.record import Record
from loco_sim.bolted.loop import Bolted
from loco_sim.plant.model import Model
from loco_sim.robot import robot

DT, ROWS = 0.005, 1600
FRICTION = {"name": "coulomb_friction", "joint": "pivot", "torque": 0.03}
PENDULUM = Model("pendulum")


def swung(effects=(), overrides=None):
    """A pendulum under a torque that was thrown together, as it would be measured."""
    torque = gaussian_filter1d(np.random.default_rng(3).normal(size=ROWS), 30.0)
    torque *= 0.12 / torque.std()
    t = DT * np.arange(ROWS)
    start = {"q": np.zeros((ROWS, 1))}
    told = Record("swung", t, {"torque": torque[:, None]}, ("pivot",), start, ("pivot",))
    (said,) = Forward(Model("pendulum", overrides or {}), [told])(effects, step=0.25)
    return replace(told, signals={"q": said[:, :1]})


def rms(forward, *args):
    (said,), (measured,) = forward(*args), forward.measured
    return float(np.sqrt(np.nanmean((said - measured) ** 2)))


def test_a_model_that_lacks_nothing_needs_the_torque_it_was_told():
    forward = led.InverseDynamics(PENDULUM, [swung()])
    assert [str(c) for c in forward.channels] == ["tau pivot"]
    assert rms(forward) < 0.02 * np.nanstd(forward.measured[0])


@pytest.mark.parametrize("frequency", [3.0, 4.0])
def test_a_fast_motion_needs_its_torque_as_a_slow_one_does(frequency):
    """A drive that falls short of the motion misses as much of its torque, 3 % at 4 Hz."""
    record = swung()
    torque = 0.3 * np.sin(2.0 * np.pi * frequency * record.t)[:, None]
    told = replace(record, command={"torque": torque})
    (said,) = Forward(PENDULUM, [told])(step=0.25)
    forward = led.InverseDynamics(PENDULUM, [replace(told, signals={"q": said[:, :1]})])
    (needed,), (measured,) = forward(step=0.25), forward.measured
    assert np.sqrt(np.nanmean((needed - measured) ** 2)) < 0.008 * np.nanstd(measured)


def test_friction_shows_as_the_torque_that_it_takes():
    forward = led.InverseDynamics(PENDULUM, [swung([FRICTION])])
    assert rms(forward) == pytest.approx(0.03, rel=0.2)  # it brakes all the time
    # Where the pendulum turns round it is held, by any torque up to that: a part stays open.
    assert rms(forward, [FRICTION]) < 0.25 * rms(forward)


def test_torques_of_a_joint_that_friction_holds_are_not_compared():
    """A Franka's wrist stops for a second at each end, whose torques looked like a spring's."""
    t = DT * np.arange(2400)
    told = replace(swung(), t=t, command={"torque": 0.06 * np.sin(1.3 * t)[:, None]},
                   signals={"q": np.zeros((2400, 1))})  # fmt: skip
    level = Model("pendulum", {"sim.gravity": 0.0, "dynamics.pivot.damping": 0.01})
    (moved,) = Forward(level, [told])([FRICTION], step=0.25)
    forward = led.InverseDynamics(level, [replace(told, signals={"q": moved[:, :1]})])
    assert rms(forward, [FRICTION]) < 0.05 * rms(forward)
    speed = np.abs(forward.records[0].signals["dq"])
    moves = speed > led.STATIONARY * np.sqrt(np.mean(np.square(speed)))
    between = np.flatnonzero(np.isfinite(forward.measured[0][:, 0]))
    assert moves[between].mean() > 0.99
    (note,) = forward.records[0].notes
    assert note.startswith("pivot is stationary ") and 20 < int(note.split()[3][:-1]) < 60
    assert 0.5 < len(between) * np.diff(between).min() / moves.sum() < 1.0


def test_friction_is_no_limit_of_the_torque():
    """A limit of nearly nothing, taken off the command, left nothing to explain where friction acts."""
    t = DT * np.arange(2400)
    slow, command = np.sin(0.8 * t)[:, None], 0.03 * np.sign(np.cos(0.8 * t))[:, None]
    told = replace(swung(), t=t, command={"torque": command}, signals={"q": slow})
    level = Model("pendulum", {"sim.gravity": 0.0, "dynamics.pivot.damping": 1e-4})
    forward = led.InverseDynamics(level, [told])
    limit = {"name": "torque_limit", "joint": "pivot", "rated": 0.1, "reduction": 0.99}
    assert rms(forward, [limit]) > 0.5 * rms(forward)


def test_a_joint_that_only_turns_round_is_compared_there():
    (quick,) = led.InverseDynamics(PENDULUM, [swung()]).measured
    still = led.InverseDynamics(PENDULUM, [replace(swung(), signals={"q": np.zeros((ROWS, 1))})])
    assert np.isfinite(quick).sum() == np.isfinite(still.measured[0]).sum()


def test_gain_and_bias_of_a_torque_drive_count_as_in_a_simulation():
    values = {"drives.pivot.gain": 0.8, "drives.pivot.bias": 0.02}
    forward = led.InverseDynamics(PENDULUM, [swung(overrides=values)])
    assert rms(forward, (), values) < 0.1 * rms(forward)


@pytest.mark.parametrize(
    "effect",
    [{"name": "actuator_lag", "time": 0.01}, {"name": "actuator_lag", "time": 0.2},
     {"name": "actuation_delay", "delay": 0.04}, {"name": "torque_hold", "period": 0.05}],
)  # fmt: skip
def test_a_late_drive_is_commanded_earlier(effect):
    """In the drive that tracks the motion a lag of 35 ms was unstable, and never found."""
    forward = led.InverseDynamics(PENDULUM, [swung([effect])])
    assert rms(forward, [effect]) < 0.03 * np.nanstd(forward.measured[0])
    assert rms(forward, [effect]) < 0.3 * rms(forward)
    size = {key: 1.3 * value for key, value in effect.items() if key != "name"}
    assert rms(forward, [effect]) < 0.5 * rms(forward, [{**effect, **size}])


def test_values_of_a_robot_are_refitted_with_every_model_within_what_is_usual():
    for factor in (1.02, 1.5):
        forward = led.InverseDynamics(PENDULUM, [swung((), {"bodies.rod.mass": factor})])
        case = cases.prepare(forward, forward.records, [])
        bare, fitted = (
            np.sqrt(np.nanmean(np.square(residual)))
            for residual in (case.bare([], {})[0], case.whitened([])[0])
        )
        mass = case.suited([], {})[1]["bodies.rod.mass"]
        assert mass == pytest.approx(min(factor, 1.0 + 2.5 * 0.02), abs=0.012)
        assert bool(fitted < 0.5 * bare) is (factor == 1.02)


STRONG = Model("pendulum", {"drives.pivot.gain": 10.0})  # it goes over the top
RUBS = Model("pendulum", {}, [FRICTION])
HEAVY = Model("pendulum", {"bodies.rod.mass": 3.0})


def pushed(damping, seconds=16.0, gravity=9.81):
    """The pendulum with as much damping, under a torque that nobody made from its motion."""
    values = {"dynamics.pivot.damping": damping, "sim.gravity": gravity}
    record = swung()
    rows = round(seconds / DT)
    torque = gaussian_filter1d(np.random.default_rng(5).normal(size=rows), 20.0)[:, None]
    torque *= 0.02 / np.std(torque)
    told = replace(record, t=DT * np.arange(rows), command={"torque": torque},
                   signals={"q": 0.0 * torque})  # fmt: skip
    (said,) = Forward(Model("pendulum", values), [told])(step=0.25)
    return replace(told, signals={"q": said[:, :1]})


@pytest.mark.parametrize("model", [PENDULUM, STRONG, RUBS, HEAVY])
@pytest.mark.parametrize(
    ("damping", "gravity", "how"),
    [
        (0.1, 9.81, Forward.how),
        (1e-4, 9.81, led.InverseDynamics.how),
        (2e-3, 0.0, led.InverseDynamics.how),
    ],
)
def test_the_way_of_comparison_follows_from_what_was_measured(model, damping, gravity, how):
    """A motion that forgets is run; one that nothing damps, or nothing pulls back, is led."""
    assert led.forward(model, [pushed(damping, gravity=gravity)]).how == how


@pytest.mark.parametrize("model", [PENDULUM, RUBS])
def test_a_body_that_nothing_drives_is_judged_in_pieces(model):
    """Torques of 0 were not measured along the motion: all that moves it needs none."""
    told = swung()
    rest = replace(told, command={"torque": 0.0 * told.command["torque"]})
    forward = led.forward(model, [rest])
    assert forward.how == Forward.how and forward.params.window > 0.0
    assert [str(c) for c in forward.channels] == ["q pivot"]


@pytest.mark.parametrize(("angle", "how"), [(0.0, Forward.how), (1.2, led.InverseDynamics.how)])
def test_a_joint_that_its_weight_would_move_far_is_compared_along_its_motion(angle, how):
    """A tenth less of the torque that holds the rod, and it falls, whatever decays there."""
    t, w = DT * np.arange(3200), np.array([[2.0], [5.0]])
    size = np.array([[0.1], [0.05]])
    q = angle + np.sum(size * np.sin(w * t), axis=0)
    dq, ddq = np.sum(size * w * np.cos(w * t), axis=0), -np.sum(size * w**2 * np.sin(w * t), axis=0)
    torque = 0.0267 * ddq + 0.1 * dq + 0.5 * 9.81 * 0.2 * np.sin(q)
    record = replace(swung(), t=t, command={"torque": torque[:, None]}, signals={"q": q[:, None]})
    damped = Model("pendulum", {"dynamics.pivot.damping": 0.1})
    assert led.forward(damped, [record]).how == how


ROTARY = """<robot name="rotary"><link name="base"/>
<link name="arm"><inertial><origin xyz="0.1 0 0"/><mass value="0.2"/>
<inertia ixx="1e-4" iyy="2e-3" izz="2e-3" ixy="0" ixz="0" iyz="0"/></inertial></link>
<link name="rod"><inertial><origin xyz="0 0 -0.15"/><mass value="0.1"/>
<inertia ixx="8e-4" iyy="8e-4" izz="1e-5" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="turn" type="continuous"><parent link="base"/><child link="arm"/><axis xyz="0 0 1"/>
</joint><joint name="swing" type="continuous"><parent link="arm"/><child link="rod"/>
<origin xyz="0.2 0 0"/><axis xyz="1 0 0"/></joint></robot>"""


@pytest.mark.parametrize(("stiffness", "pieces"), [(0.2, False), (0.0, True)])
def test_a_driven_joint_beside_a_passive_one_is_run_only_if_it_forgets(tmp_path, stiffness, pieces):
    """The rod of a rotary pendulum has no drive; without a spring its arm drifts."""
    (tmp_path / "rotary.urdf").write_text(ROTARY)
    (tmp_path / "robot.yaml").write_text(
        "urdf: rotary.urdf\njoints: [turn, swing]\nfixed_base: true\n"
        "drives: {turn: {kind: torque}}\nsprings: {turn: {kind: linear, stiffness: 0}}\n"
    )
    values = {"dynamics.turn.damping": 0.03, "springs.turn.stiffness": stiffness}
    model = Model(str(tmp_path), values)
    torque = gaussian_filter1d(np.random.default_rng(5).normal(size=ROWS), 20.0)[:, None]
    still = {"q": np.zeros((ROWS, 2))}
    command = {"torque": 0.01 * torque / np.std(torque)}
    told = Record("rotary", DT * np.arange(ROWS), command, ("turn",), still, ("turn", "swing"))
    (said,) = Forward(model, [told])(step=0.25)
    record = replace(told, signals={"q": said[:, :2]})
    heavier = replace(model, overrides={**model.overrides, "bodies.arm.mass": 1.01})
    chosen = led.forward(heavier, [record])
    assert chosen.how == Forward.how
    assert (chosen.params.window > 0.0) is pieces


def test_noise_and_rounding_of_readings_do_not_change_it():
    record, rng = pushed(0.1), np.random.default_rng(1)
    q = record.signals["q"] + 3e-4 * rng.standard_normal(record.signals["q"].shape)
    noisy = replace(record, signals={"q": 1e-3 * np.round(q / 1e-3)})
    assert led.forward(PENDULUM, [noisy]).how == Forward.how


@pytest.mark.parametrize("model", [PENDULUM, STRONG, RUBS])
def test_a_torque_that_follows_from_the_velocity_is_judged_in_pieces(model):
    record = swung()
    speed = np.gradient(record.signals["q"][:, 0], DT)[:, None]
    fed = replace(record, command={"torque": 0.1 * np.tanh(4.0 * speed)})
    (mine,), (own,) = (led.measured(Forward(model, [r])) for r in (fed, record))
    assert mine.fed_back > led.FED_BACK > own.fed_back
    forward = led.forward(model, [fed])
    assert forward.how == Forward.how
    assert forward.params.window == led.forward(PENDULUM, [fed]).params.window in led.WINDOWS


def test_a_torque_that_friction_takes_at_low_speed_is_compared_along_the_motion():
    """Speed explains it as it does that of a controller, but no inertia takes as much."""
    t = 0.0193 * np.arange(3000)
    turned = 0.2 * np.sin(0.4 * t)
    torque = 0.3 * np.sign(np.cos(0.4 * t)) + 0.02 * np.sin(1.3 * t)
    motion = {"q": turned[:, None]}
    slow = Record("slow", t, {"torque": torque[:, None]}, ("pivot",), motion, ("pivot",))
    level = Model("pendulum", {"sim.gravity": 0.0})
    (said,) = led.measured(Forward(level, [slow]))
    assert said.fed_back > led.FED_BACK
    assert led.forward(level, [slow]).how == led.InverseDynamics.how


@pytest.mark.parametrize(("damping", "gravity"), [(0.02, 9.81), (0.05, 9.81), (0.004, 0.0)])
def test_a_joint_tells_its_feedback_and_how_fast_it_forgets(damping, gravity):
    """Half the damping over the inertia; without gravity it keeps its place for ever."""
    (said,) = led.measured(Forward(PENDULUM, [pushed(damping, gravity=gravity)]))
    plant = Bolted(replace(Forward(PENDULUM, [swung()]).robot(), sensors=None))
    slow = 0.5 * damping / float(plant.inertia(np.zeros(1))[0, 0])
    if gravity:
        assert said.decay == pytest.approx(slow, rel=0.2)
    else:
        assert said.decay * 16.0 < 0.5 * led.DECAY_TIMES
    assert said.fed_back < 0.5


@pytest.mark.parametrize(
    "effect",
    [
        {"name": "torque_limit", "reduction": 0.92},
        {"name": "actuation_delay", "delay": 0.03},
        {"name": "actuator_lag", "time": 0.03},
        {"name": "torque_speed_line", "slope": 0.7},
    ],
)
def test_what_a_model_says_of_commands_and_drives_is_done_to_the_torque_it_was_told(effect):
    """A robot with its effect in model.yaml has no gap, though it is led; without it, it has."""
    record, right = swung([effect]), Model("pendulum", {}, [effect])
    left = rms(led.InverseDynamics(right, [record]))
    assert left < 0.3 * rms(led.InverseDynamics(PENDULUM, [record]))
    assert left < 0.05 * np.nanstd(led.InverseDynamics(right, [record]).measured[0])


@pytest.mark.parametrize("joint_torque", [False, True])
def test_a_torque_that_passes_through_a_drive_has_no_spring_in_it(tmp_path, joint_torque):
    for file in robot.load("pendulum").folder.glob("*.*"):
        (tmp_path / file.name).write_text(file.read_text())
    spring = "springs:\n  pivot: {kind: linear, stiffness: 3.0, rest: 0.2}\n"
    (tmp_path / "robot.yaml").open("a").write(spring)
    record = replace(swung(), joint_torque=joint_torque)
    limit = {"name": "torque_limit", "rated": 100.0, "reduction": 0.1}  # far above the torque
    (passed,) = led._with_torques(Model(str(tmp_path), {}, [limit]), [record])
    change = passed.command["torque"][2:] - record.command["torque"][1:-1]
    assert np.median(np.abs(change)) < 0.01 * np.abs(record.command["torque"]).max()


def test_a_slope_turns_the_weight_and_is_tried_as_no_sensor_is():
    slope = {"name": "slope", "pitch": 0.1}
    forward = led.InverseDynamics(PENDULUM, [swung([slope])])
    assert rms(forward, [slope]) < 0.3 * rms(forward)
    case, robot = cases.prepare(forward, forward.records, []), forward.robot()
    offers = offer(robot, case.signals, hints.find(case, robot))
    names = {h.effect for h in forward.shown(offers)}
    assert {"slope", "payload", "coulomb_friction"} <= names
    assert {"sensor_latency", "sensor_gain"} <= {h.effect for h in offers} - names


@pytest.mark.parametrize("effect", [{"name": "sensor_bias", "q": 0.01},
                                    {"name": "sensor_noise", "q": 0.01}])  # fmt: skip
def test_what_a_model_says_of_sensors_leads_it_nowhere_else(effect):
    forward = led.InverseDynamics(Model("pendulum", {}, [effect]), [swung()])
    assert rms(forward) < 0.02 * np.nanstd(forward.measured[0])


def test_values_that_are_uncertain_are_refitted_without_a_simulation(monkeypatch):
    truth = {"bodies.rod.mass": 1.3}
    forward = led.InverseDynamics(PENDULUM, [swung([FRICTION], truth)])
    plain = cases.prepare(forward, forward.records, [])
    assert not plain.loose.stated.any()
    robot = replace(forward.given(), uncertain={"bodies.rod.mass": 0.2})
    monkeypatch.setattr(forward, "given", lambda: robot)
    case = cases.prepare(forward, forward.records, [])
    before = case.count
    case.whitened([FRICTION])
    assert case.count == before + 1
    found = case.suited([FRICTION], {})[1]["bodies.rod.mass"]
    assert found == pytest.approx(1.3, rel=0.03)
    left = [np.sqrt(np.nanmean(np.square(c.whitened([FRICTION])[0]))) for c in (plain, case)]
    assert left[1] < 0.3 * left[0]


@pytest.mark.parametrize("effects", [[], [FRICTION]])
def test_a_link_that_is_refitted_to_next_to_nothing_is_led_all_the_same(effects):
    forward = led.InverseDynamics(PENDULUM, [swung()])
    light = {"bodies.rod.mass": 1e-3, "bodies.rod.inertia": 1e-3}
    (said,) = forward(effects, light)
    known = np.isfinite(forward.measured[0])
    assert np.isfinite(said[known]).all()
    asked = [f"bodies.rod.{name}" for name in ("mass", "inertia")]
    whole = rms(forward, effects, dict.fromkeys(asked, 1.0))
    assert rms(forward, effects, light) > whole  # what the rod needed is missing


@pytest.mark.parametrize("damping", [0.03, 0.1, 0.3])
def test_a_joint_is_led_however_much_it_is_braked(damping):
    """Its brake is up to five times that of a drive for its inertia alone."""
    light = {"bodies.rod.mass": 0.01, "bodies.rod.inertia": 0.01}
    brake = {"name": "viscous_friction", "joint": "pivot", "damping": damping}
    forward = led.InverseDynamics(Model("pendulum", light), [swung([brake], light)])
    assert rms(forward, [brake]) < 0.03 * np.nanstd(forward.measured[0])


@pytest.mark.parametrize("joints", [1, 2, 6])
def test_feedback_is_of_all_joints(monkeypatch, joints):
    """Friction explains most of the torque of a light wrist, and little of that of a shoulder."""
    said = [led.Free(0.95, -1.0, 0.5)] * (joints - 1) + [led.Free(0.4, -1.0, 0.5)]
    monkeypatch.setattr(led, "measured", lambda forward: said)
    assert led.forward(PENDULUM, [swung()]).how == led.InverseDynamics.how
    monkeypatch.setattr(led, "measured", lambda forward: [led.Free(0.95, -1.0, 0.5)] * joints)
    assert led.forward(PENDULUM, [swung()]).how == Forward.how
