# SPDX-License-Identifier: Apache-2.0
"""Estimated state of an unmeasured base: attitude from the IMU, height and velocity from the feet.

A standing foot is at rest at its contact point, so joints and gyro give velocity and height of the
base; without contact the accelerometer is integrated. Both are combined over the whole record by
least squares. The weight of the accelerometer follows from its noise, that of the feet from their
agreement with it: on a robot whose feet slide all the time they count little.
Source: Bloesch et al. 2012, State estimation for legged robots, RSS; there it is a filter.
"""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from typing import NamedTuple

import numpy as np
from scipy.linalg import solveh_banded

from loco_sim.geometry import multiply
from loco_sim.robot.equipment import GRAVITY
from loco_sim.robot.frames import link_frames, numbers
from loco_sim.robot.robot import Robot

from ..recordings.record import Record, bridged
from ..statistics import evidence, noise
from .channels import heading
from .phases import LOADED

TIME_STEP = 1e-4  # time step of the finite difference for the velocity of contact points [s]
LOW = 0.01  # without forces: height of a standing foot over the lowest one, over standing height
ROUNDS = 6  # updates of the weights
SPEED, HEIGHT = 1e-3, 1e-4  # smallest deviation of foot velocities [m/s] and heights [m]
SLIDING, RISING = 3.0, 0.01  # their initial deviations [m/s], [m]
BIAS = 0.2  # error of an accelerometer, its tilt included [m/s²]
COARSE = 5.0  # deviation of the acceleration of a base without accelerometer [m/s²]
DRIFT = 0.1  # error of the vertical velocity [m/s]
REST = 0.03  # bound on rates [rad/s] and accelerations [g] of a base initially at rest


class Legs(NamedTuple):
    """Estimates from IMU and legs, in the frame of the base's first sample (place and heading)."""

    dt: float  # time between samples [s]
    turn: np.ndarray  # attitude, x y z w, (T, 4)
    spin: np.ndarray  # angular velocity in the world [rad/s], (T, 3)
    speed: np.ndarray  # velocity of the base if each foot is at rest [m/s], (T, f, 3)
    height: np.ndarray  # height of the base if each foot touches the ground [m], (T, f)
    stands: np.ndarray  # flags of standing feet, (T, f)
    steps: np.ndarray  # flags of a touch-down or lift-off of any foot, (T,)
    load: np.ndarray  # ground force on each foot, 0 where it does not stand [N], (T, f)
    pull: np.ndarray  # acceleration of the base [m/s²], (T, 3)
    doubt: float  # standard deviation of the acceleration [m/s²]
    still: bool  # whether the base is initially at rest


class BaseMotion(NamedTuple):
    """Motion of a base over flat ground, in the frame of its first sample."""

    velocity: np.ndarray  # velocity of the origin in the world [m/s], (T, 3)
    height: np.ndarray  # height of the origin over the ground [m], (T,)
    apart: tuple[float, float]  # typical deviation of velocity [m/s] and height [m]


def legs(record: Record, robot: Robot, q: np.ndarray, dq: np.ndarray) -> Legs | None:
    """Estimates from IMU and legs; None if no attitude was measured or no foot ever stands.

    Args:
        record: Measured record.
        robot: The robot with the values of the model.
        q: Smoothed joint positions [rad or m], (T, n).
        dq: Smoothed joint velocities, (T, n).
    """
    attitude = record.signals.get("orientation")
    if attitude is None or not robot.feet or not np.isfinite(attitude).all(axis=1).any():
        return None
    turn = even(at_home(bridged(attitude), heading(attitude)))
    rotation = matrices(turn)
    gyro = record.signals.get("gyro")
    spin = rates(turn, record.dt) if gyro is None else rotate(rotation, bridged(gyro))
    at, speed = touching(robot, np.nan_to_num(q), np.nan_to_num(dq), rotation)
    arm = rotate(rotation[:, None], at)
    stance = standing(record, robot, arm[..., 2])
    if not stance.any():
        return None
    velocity = -(rotate(rotation[:, None], speed) + np.cross(spin[:, None], arm))
    force, pull, sigma = record.signals.get("acceleration"), np.zeros((len(turn), 3)), COARSE
    if force is not None:
        pull, sigma = rotate(rotation, bridged(force)) - np.array([0.0, 0.0, GRAVITY]), BIAS
    rests = bool(np.all(np.abs(np.concatenate([spin[0], pull[0]])) < REST * GRAVITY))
    steps = np.any(np.diff(stance, axis=0, prepend=stance[:1]), axis=1)
    load = np.where(stance, loads(record, robot, stance), 0.0)
    stiff = np.array([robot.contact.get(f, (robot.sim.contact_stiffness,))[0] for f in robot.feet])
    height = -arm[..., 2] - np.where(stiff > 0.0, load / np.maximum(stiff, 1e-300), 0.0)
    return Legs(record.dt, turn, spin, velocity, height, stance, steps, load, pull, sigma, rests)


def estimate_base(legs: Legs, depth: np.ndarray | None = None) -> BaseMotion:
    """Motion of the base from IMU and legs together.

    Args:
        legs: Estimates from IMU and legs.
        depth: Penetration of each foot into the ground, beyond the model's own [m], (T, f).
    """
    speed, height = legs.speed, legs.height
    if depth is not None:
        speed, height = speed.copy(), height - depth
        speed[..., 2] -= np.gradient(depth, legs.dt, axis=0)
    deviations = (SLIDING, SPEED), legs.dt * legs.doubt, legs.still
    axes = [
        fuse(speed[..., k], legs.stands, legs.dt * legs.pull[1:, k], *deviations) for k in range(3)
    ]
    velocity = np.stack([v for v, _ in axes], axis=1)
    rise = 0.5 * legs.dt * (velocity[1:, 2] + velocity[:-1, 2])
    high, low = fuse(height, legs.stands, rise, (RISING, HEIGHT), legs.dt * DRIFT)
    return BaseMotion(velocity, high, (float(np.mean([d for _, d in axes])), low))


def fuse(
    values: np.ndarray,
    holds: np.ndarray,
    change: np.ndarray,
    std: tuple[float, float],
    change_std: float,
    at_zero: bool = False,
) -> tuple[np.ndarray, float]:
    """Fusion of values that standing feet measure with a known change per sample.

    Banded least squares. The deviation of the feet follows from their residual: its median size and
    its correlation time (the longest found, since feet that always slide in the same direction bias
    the estimate). Outliers have less weight (Huber).

    Args:
        values: Value by each foot, (T, f).
        holds: Flags of valid samples, (T, f).
        change: Known change from each sample to the next, (T - 1,).
        std: Initial standard deviation of the values, and the smallest.
        change_std: Standard deviation of the change.
        at_zero: Whether the value is 0 at the first sample.

    Returns:
        Values, (T,), and their typical standard deviation.
    """
    rows, (std, min_std), long = len(values), std, 1.0
    weight = holds.astype(float)
    for _ in range(ROUNDS):
        trust, stiff = weight.sum(axis=1) / std**2, 1.0 / change_std**2
        trust[0] += at_zero / change_std**2
        band = np.zeros((2, rows))
        band[1] = trust + 1e-12
        band[1, 1:] += stiff
        band[1, :-1] += stiff
        band[0, 1:] = -stiff
        side = (weight * np.where(holds, values, 0.0)).sum(axis=1) / std**2
        side[1:] += stiff * change
        side[:-1] -= stiff * change
        value = solveh_banded(band, side)
        left = np.where(holds, values - value[:, None], np.nan)
        usual = max(min_std, noise.TO_DEVIATION * float(np.nanmedian(np.abs(left))))
        long = max(long, np.median([evidence.correlation_time(column) for column in left.T]))
        std = usual * float(np.sqrt(long))
        weight = np.where(
            holds, 1.0 / np.maximum(np.abs(values - value[:, None]) / (2.0 * usual), 1.0), 0.0
        )
    usual = np.median(trust[trust > 0.0])
    return value, float((4.0 * usual / change_std**2 + usual**2) ** -0.25)  # infinitely long band


def touching(
    robot: Robot, q: np.ndarray, dq: np.ndarray, rotation: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Lowest point of the sphere of each foot, and the velocity of the material point there.

    Returns:
        Points [m] and velocities [m/s] in the frame of the base, (T, f, 3) each.
    """
    balls = feet_of(robot.urdf, robot.feet)
    down = -rotation[:, 2, :]  # in the base frame
    frames, later, before = (
        link_frames(robot, q + s * TIME_STEP * dq, robot.feet) for s in (0.0, 1.0, -1.0)
    )
    at, speed = [], []
    for foot, (centre, radius) in zip(robot.feet, balls, strict=True):
        turn, origin = frames[foot]
        sole = centre + np.einsum("tji,tj->ti", turn, radius * down)  # in the frame of the foot
        positions = [o + np.einsum("tij,tj->ti", r, sole) for r, o in (later[foot], before[foot])]
        at.append(origin + np.einsum("tij,tj->ti", turn, sole))
        speed.append((positions[0] - positions[1]) / (2.0 * TIME_STEP))
    return np.stack(at, axis=1), np.stack(speed, axis=1)


def feet_of(urdf: str, feet: tuple[str, ...]) -> list[tuple[np.ndarray, float]]:
    """Centre (3,) and radius of each foot's sphere [m], in its link; radius 0 without a sphere."""
    spheres = []
    links = {link.get("name"): link for link in ElementTree.fromstring(urdf).iter("link")}
    for foot in feet:
        shapes = links[foot].findall("collision")
        balls = [c for c in shapes if c.find("geometry/sphere") is not None]
        if not balls:
            spheres.append((np.zeros(3), 0.0))
            continue
        radius = float(balls[0].find("geometry/sphere").get("radius"))
        spheres.append((numbers(balls[0].find("origin"), "xyz", "0 0 0"), radius))
    return spheres


def standing(record: Record, robot: Robot, low: np.ndarray) -> np.ndarray:
    """Flags of standing feet, from their force, or from their height without force sensor, (T, f).

    The first and last sample of each contact are left out: a landing foot is not at rest.

    Args:
        record: Measured record.
        robot: The robot.
        low: Height of each foot's lowest point over the base, (T, f).
    """
    force = record.feet_of(robot.feet)
    valid = np.isfinite(force).any(axis=0)
    lowest = low.min(axis=1, keepdims=True)
    stance = low - lowest < LOW * np.median(-lowest)
    for foot in np.flatnonzero(valid):
        values = bridged(force[:, [foot]])[:, 0]
        stance[:, foot] = values > LOADED * np.quantile(values, 0.95)
    inside = stance.copy()
    inside[1:] &= stance[:-1]
    inside[:-1] &= stance[1:]
    return inside


def loads(record: Record, robot: Robot, stance: np.ndarray) -> np.ndarray:
    """Ground force on each foot [N], (T, f): measured, or an equal share of the weight."""
    share = robot.mass * GRAVITY / np.maximum(stance.sum(axis=1, keepdims=True), 1)
    force = record.feet_of(robot.feet)
    return np.where(np.isfinite(force), np.maximum(force, 0.0), share)


def at_home(turn: np.ndarray, yaw: float) -> np.ndarray:
    """Attitudes x y z w relative to a heading [rad], (T, 4)."""
    home = (0.0, 0.0, float(np.sin(-0.5 * yaw)), float(np.cos(-0.5 * yaw)))
    return np.array([multiply(home, row) for row in turn.tolist()])


def even(turn: np.ndarray) -> np.ndarray:
    """Unit quaternions x y z w without sign changes between neighbours, (T, 4)."""
    signs = np.sign(np.sum(turn[1:] * turn[:-1], axis=1))
    turn = turn.copy()
    turn[1:] *= np.cumprod(np.where(signs < 0.0, -1.0, 1.0))[:, None]
    return turn / np.linalg.norm(turn, axis=1, keepdims=True)


def rates(turn: np.ndarray, dt: float) -> np.ndarray:
    """Angular velocity in the world [rad/s], (T, 3), from attitudes x y z w."""
    change = np.gradient(turn, dt, axis=0)
    back = turn * np.array([-1.0, -1.0, -1.0, 1.0])
    both = zip(change.tolist(), back.tolist(), strict=True)
    return np.array([multiply(c, b)[:3] for c, b in both]) * 2.0


def matrices(turn: np.ndarray) -> np.ndarray:
    """Rotation matrices of attitudes x y z w, (T, 3, 3)."""
    x, y, z, w = turn.T
    rows = [
        [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - z * w), 2.0 * (x * z + y * w)],
        [2.0 * (x * y + z * w), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - x * w)],
        [2.0 * (x * z - y * w), 2.0 * (y * z + x * w), 1.0 - 2.0 * (x * x + y * y)],
    ]
    return np.moveaxis(np.array(rows), -1, 0)


def rotate(rotation: np.ndarray, vectors: np.ndarray) -> np.ndarray:
    """Rotated vectors, broadcast: (…, 3, 3) times (…, 3)."""
    return np.einsum("...ij,...j->...i", rotation, vectors)
