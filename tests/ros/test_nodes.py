# SPDX-License-Identifier: Apache-2.0
"""Each controller node alone, over real DDS: a test publishes ticks and reads the answers."""

import numpy as np
import pytest
from geometry_msgs.msg import TwistStamped
from rclpy.parameter import Parameter
from std_msgs.msg import Float64, String

from loco_control.gait.generator import GaitParams, TargetGenerator
from loco_control.ros.messages.convert import Converter
from loco_control.ros.stance_node import StanceControllerNode
from loco_control.ros.target_node import TargetGeneratorNode
from loco_control.types import GaitTarget, MotionCommand, RobotState, Stance, TrunkTorque
from loco_learning.ros.reflex_node import ReflexNetworkNode

pytestmark = pytest.mark.ros


def standing(tick):
    q = np.tile([-0.12, 0.70, -1.42], 4) * np.repeat([1, 1, -1, -1], 3)
    q[0::3] = -0.12
    grf = np.zeros((4, 3))
    grf[:, 2] = 207.0
    return RobotState(
        tick, tick * 0.004, q, np.zeros(12), np.zeros(12), grf,
        np.array([0.0, 0.0, 0.0, 1.0]), np.zeros(3), np.array([0.0, 0.0, 9.81]), np.ones(4, bool),
    )  # fmt: skip


def walk(bench, states, answers, ticks, start=0):
    pack = Converter(RobotState).pack
    for tick in range(start, start + ticks):
        states.publish(pack(standing(tick)))
        bench.wait(lambda tick=tick: answers and answers[-1].tick == tick)


def test_target_node_answers_as_the_generator_does_without_ros(bench):
    b = bench(TargetGeneratorNode)
    states, targets = b.publisher("robot_state"), b.listen("gait_target", GaitTarget)
    walk(b, states, targets, 300)
    generator = TargetGenerator(GaitParams(), 0.004)
    pack = Converter(GaitTarget).pack
    expected = [pack(generator.step(standing(k))) for k in range(300)]
    assert [pack(t) for t in targets] == expected


def test_speed_and_frequency_follow_topics_smoothly(bench):
    b = bench(TargetGeneratorNode)
    states, targets = b.publisher("robot_state"), b.listen("gait_target", GaitTarget)
    walk(b, states, targets, 900)
    velocity = TwistStamped()
    velocity.twist.linear.x = 0.1
    b.publisher("cmd_vel").publish(velocity)
    b.publisher("gait_frequency").publish(Float64(data=1.2))
    walk(b, states, targets, 900, start=900)
    speeds = np.array([t.speed for t in targets])
    assert speeds[899] == pytest.approx(0.25, abs=0.02)
    assert speeds[-1] == pytest.approx(0.1, abs=0.005)
    assert targets[-1].frequency == pytest.approx(1.2, abs=0.02)
    assert np.abs(np.diff(speeds[900:])).max() < 0.01  # no jump


def test_a_velocity_out_of_reach_is_cut_and_told(bench):
    b = bench(TargetGeneratorNode)
    states, targets = b.publisher("robot_state"), b.listen("gait_target", GaitTarget)
    events = b.listen("events", wait=False)
    velocity, say = TwistStamped(), b.publisher("cmd_vel")
    velocity.twist.linear.y, velocity.twist.angular.z = 0.1, 0.3
    say.publish(velocity)
    b.wait(lambda: any(e.text == "cmd_vel 0.0 0.1 0.3" for e in events if e.kind == "heard"))
    walk(b, states, targets, 900)
    assert targets[-1].speed == pytest.approx(0.0, abs=1e-3)
    sideways = np.abs([t.foot_velocity.reshape(4, 3)[:, 1] for t in targets[-100:]])
    assert sideways.max() > 0.1
    assert b.node.diagnose() == {} and not [e for e in events if e.kind == "clipped"]
    velocity.twist.linear.x = 30.0
    say.publish(velocity)
    b.wait(lambda: any(e.kind == "clipped" for e in events))
    text = next(e.text for e in events if e.kind == "clipped")
    assert text.startswith("cmd_vel: speed 30 is cut to ") and "reach of the legs" in text
    assert b.node.diagnose()["cmd_vel_clipped"] in text
    velocity.twist.linear.x = 0.1
    say.publish(velocity)
    b.wait(lambda: not b.node.diagnose())


def test_live_parameters_change_and_bad_values_are_refused(bench):
    b = bench(TargetGeneratorNode)
    refused = b.node.set_parameters([Parameter("gait.duty_factor", value=0.99)])[0]
    assert not refused.successful
    assert "0.99" in refused.reason or "range" in refused.reason
    assert b.node.set_parameters([Parameter("gait.speed", value=0.1)])[0].successful
    fixed = b.node.set_parameters([Parameter("gait.pattern", value="walk")])[0]
    assert not fixed.successful


def test_stance_node_switches_estimator_while_it_runs(bench):
    b = bench(StanceControllerNode)
    states, commands = b.publisher("robot_state"), b.publisher("motion_command")
    targets = b.publisher("gait_target")
    stances, torques = b.listen("stance", Stance), b.listen("trunk_torque", TrunkTorque)
    generator = TargetGenerator(GaitParams(start_time=0.0), 0.004)
    packs = [Converter(c).pack for c in (RobotState, GaitTarget, MotionCommand)]

    def tick(k):
        state = standing(k)
        target = generator.step(state)
        states.publish(packs[0](state))
        commands.publish(packs[2](MotionCommand(k, state.t, target.q, target.dq)))
        targets.publish(packs[1](target))
        b.wait(lambda: torques and stances and torques[-1].tick == stances[-1].tick == k)
        return target

    for k in range(100):
        target = tick(k)
        np.testing.assert_array_equal(stances[-1].stance, target.stance)
    assert {s.estimator for s in stances} == {0}
    estimator = b.publisher("stance_estimator")
    for name in ("no such", "rse"):  # the wrong one is refused and changes nothing
        estimator.publish(String(data=name))
        for _ in range(50):
            b.executor.spin_once(timeout_sec=0.01)
    for k in range(100, 300):
        tick(k)
    assert stances[-1].estimator == 1
    assert {tuple(s.stance) for s in stances[-150:]} - {tuple(s.stance) for s in stances[:1]}
    swing = ~np.repeat(torques[-1].stance, 3)
    assert not torques[-1].tau[swing].any()


def test_reflex_node_passes_the_target_through_while_it_stands(bench):
    b = bench(ReflexNetworkNode)
    states, targets = b.publisher("robot_state"), b.publisher("gait_target")
    commands = b.listen("motion_command", MotionCommand)
    generator = TargetGenerator(GaitParams(), 0.004)
    for k in range(50):
        state = standing(k)
        target = generator.step(state)
        states.publish(Converter(RobotState).pack(state))
        targets.publish(Converter(GaitTarget).pack(target))
        b.wait(lambda k=k: commands and commands[-1].tick == k)
        np.testing.assert_array_equal(commands[-1].q, target.q)
    assert b.node.diagnose()["phase"] == "stand"
