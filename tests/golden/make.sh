#!/bin/sh
# SPDX-License-Identifier: Apache-2.0
# Makes the golden bags anew; from the top folder of the repository.
set -e
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT

make() { # name, topics, then arguments of loco run
    name=$1 topics=$2
    shift 2
    ./loco run "$@" --layout rollout --out "$work/$name"
    rm -rf "tests/golden/$name"
    # shellcheck disable=SC2086
    ./loco extract "$work/$name" "tests/golden/$name" --topics $topics
}

hyq="robot_state gait_target motion_command stance trunk_torque"
joint="joint_states imu/data joint_target joint_command"

make hyq_open "$hyq" hyq_trot_open --set duration=0.6 --set gait.start_time=0.1
make hyq_reflex "$hyq learning_state" hyq_short --set gait.start_time=0.1 \
    --set learner.neurons=20 --set learner.memory=20 --set learner.stand=0.2 \
    --set learner.train=0.2 --set learner.closing=0.1 --set learner.test=0.1
make tigrillo_open "$joint" tigrillo_bound --set duration=1.5
make tigrillo_reflex "$joint joint_prediction" tigrillo_bound_reflex \
    --set learner.neurons=40 --set learner.memory=20 --set target.start_time=0.1 \
    --set learner.stand=0.4 --set learner.train=0.8 --set learner.closing=0.4 \
    --set learner.test=0.4

for engine in pybullet mujoco; do
    make "hyq_open_$engine" "$hyq" hyq_trot_open --engine "$engine" --set duration=0.6 \
        --set gait.start_time=0.1
    make "tigrillo_open_$engine" "$joint" tigrillo_bound --engine "$engine" --set duration=1.5
done
