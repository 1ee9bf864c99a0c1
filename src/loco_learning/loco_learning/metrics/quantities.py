# SPDX-License-Identifier: Apache-2.0
"""Signals computed from a log for metrics and figures, for robots of any kind."""

from __future__ import annotations

import numpy as np

from loco_sim.robot.description import Description
from loco_sim.robot.frames import feet_in_base

from ..runs.log import Log
from . import signals


def walks(log: Log) -> bool:
    """True if the robot has a gait clock and a trunk controller that holds its heading."""
    return log.experiment.gait is not None


def target_and_prediction(log: Log) -> tuple[np.ndarray, np.ndarray]:
    """Target and predicted positions of the joints that the network moves [rad], (T, k) each."""
    outputs = log.experiment.outputs
    return columns(log.target, outputs), log.prediction[:, : len(outputs)]


def outputs_wanted(log: Log) -> np.ndarray:
    """Targets of the outputs: positions [rad] and velocities [rad/s], (T, 2k)."""
    outputs = log.experiment.outputs
    return np.concatenate((columns(log.target, outputs), columns(log.target_dq, outputs)), axis=1)


def outputs_commanded(log: Log) -> np.ndarray:
    """Commands of the output joints: positions [rad] and velocities [rad/s], (T, 2k)."""
    outputs = log.experiment.outputs
    parts = columns(log.command, outputs), columns(log.command_dq, outputs)
    return np.concatenate(parts, axis=1)


def columns(values: np.ndarray, indices: np.ndarray) -> np.ndarray:
    """Selected columns of an array, (T, k); the array itself if all are selected."""
    return values if len(indices) == values.shape[1] else values[:, indices]


def period(log: Log) -> int:
    """Ticks of one stride at the target frequency, at least 1."""
    frequency = (
        float(np.mean(log.target_frequency)) if walks(log) else log.experiment.target.frequency
    )
    return max(1, round(1.0 / (frequency * log.dt)))


def stride_angle(log: Log) -> np.ndarray:
    """Stride phase of the target [strides], (T,)."""
    if walks(log):
        return log.stride_phase[:, 0]
    return log.experiment.target.frequency * log.t


def lag(log: Log) -> np.ndarray:
    """Lag of the prediction behind the target [strides], (T,)."""
    return signals.phase_lag(*target_and_prediction(log), stride_angle(log), period(log))


def progress(log: Log) -> np.ndarray:
    """Displacement along and across the initial forward direction [m], (T, 2)."""
    if walks(log):
        return log.position[:, :2] - log.position[0, :2]
    yaw = signals.roll_pitch_yaw(log.orientation[:1])[0, 2]
    x, y = (log.position[:, :2] - log.position[0, :2]).T
    return np.stack([np.cos(yaw) * x + np.sin(yaw) * y, np.cos(yaw) * y - np.sin(yaw) * x], axis=1)


def heading_speed(log: Log) -> np.ndarray:
    """Velocity of the base along its current heading [m/s], (T,)."""
    yaw = signals.roll_pitch_yaw(log.orientation)[:, 2]
    if len(log) < 2:
        return np.full(len(log), np.nan)
    dx, dy = (np.gradient(log.position[:, i]) / log.dt for i in (0, 1))
    return np.cos(yaw) * dx + np.sin(yaw) * dy


def mass(log: Log) -> float:
    """Mass of the robot [kg]."""
    if walks(log):
        return log.experiment.trunk.mass
    return Description(log.experiment.plant.urdf).mass()


def drives(log: Log) -> tuple[np.ndarray, np.ndarray]:
    """Velocity [rad/s] and torque [N·m] of the driven joints, each (T, m)."""
    driven = log.experiment.plant.driven
    return columns(log.dq, driven), columns(log.tau, driven)


def feet(log: Log, column: str = "q") -> np.ndarray:
    """Foot positions in the base frame [m], (T, f, 3), from joint positions in a column."""
    if walks(log):
        from loco_control.legs.kinematics import feet_and_jacobians  # loads numba

        legs, rows = log.experiment.plant.legs, log.columns[column].reshape(-1, 4, 3)
        return np.array([feet_and_jacobians(row, legs)[0] for row in rows])
    return feet_in_base(log.experiment.plant, log.columns[column])


def has_feet(log: Log) -> bool:
    """True if the robot of a log has feet."""
    return bool(log.experiment.plant.feet)


def passive(log: Log) -> np.ndarray:
    """Indices of the joints without a drive, (p,)."""
    plant = log.experiment.plant
    return np.setdiff1d(np.arange(len(plant.joints)), plant.driven)


def has_passive_joints(log: Log) -> bool:
    """True if the robot of a log has joints without a drive."""
    return len(passive(log)) > 0


def moves(log: Log) -> bool:
    """True if the base of the robot of a log is free."""
    return not log.experiment.plant.fixed_base
