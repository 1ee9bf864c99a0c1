# SPDX-License-Identifier: Apache-2.0
"""A walking robot in PyBullet, independent of the plant of `loco_sim`.

It has the plant interface of the control loop. The search uses MuJoCo.
"""

from __future__ import annotations

import tempfile
from collections import deque
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from loco_control.types import GroundTruth, MotionCommand, RobotState, TrunkTorque
from loco_sim.robot.robot import Robot
from loco_sim.world.bullet import pybullet as engine  # imported without its banner

from ..physics.hidden import Hidden
from ..physics.machines import GRAVITY
from . import hidden
from .walkers import Walker

TOUCH = 1.0  # smallest force of a foot in contact [N]
FAR = 0.5  # share of the initial height below which it has fallen
WORLD = engine.WORLD_FRAME


class Ground:
    """A trotting robot with hidden effects.

    Attributes:
        robot: Robot description of the controllers: names and order of joints and feet.
        fallen: Reason why it counts as fallen; None before a fall.
    """

    def __init__(
        self,
        walker: Walker,
        robot: Robot,
        standing: Sequence[float],
        effects: Sequence[Hidden] = (),
        noise: float = 1.0,
        off: bool = False,
        seed: int = 0,
    ):
        """Load the robot; nothing moves before `reset`.

        Args:
            walker: The nominal robot.
            robot: Robot description of the controllers: joints, feet.
            standing: Joint positions at the start [rad], (n,).
            effects: Hidden effects.
            noise: Factor on the walker's sensor noise.
            off: Whether bodies and motors have small errors.
            seed: Seed of these errors and of the noise.
        """
        self.robot, self._walker, self._noise, self._seed = robot, walker, noise, seed
        self._effects = {e.effect: e.params for e in effects}
        self._standing = np.array(standing, dtype=float)
        self._dt = 1.0 / robot.control_rate / walker.steps
        gains = np.array([walker.gains_of(j) for j in robot.joints])
        self._stand, self._swing = gains[:, :2].T, gains[:, 2:].T
        effort, strong = walker.effort(), hidden.motors(walker, off, seed)
        self._effort = np.array([effort[j] for j in robot.joints])
        self._strong = np.array([strong[j] for j in robot.joints])
        weak = self._effects.get("torque_constant_error")
        if weak:
            self._strong[robot.joints.index(weak["joint"])] *= 1.0 + weak["error"]
        self._client = engine.connect(engine.DIRECT)
        self._build(hidden.bodies(walker, effects, off, seed))

    def _build(self, urdf: str) -> None:
        c = self._client
        engine.setTimeStep(self._dt, physicsClientId=c)
        slope = self._effects.get("slope", {"pitch": 0.0, "roll": 0.0})
        # The world frame is aligned with the ground; a slope rotates gravity.
        self._level = Rotation.from_euler("y", -slope["pitch"]) * Rotation.from_euler(
            "x", slope["roll"]
        )
        self._gravity = self._level.inv().apply([0.0, 0.0, -GRAVITY])
        engine.setGravity(*self._gravity, physicsClientId=c)
        engine.setPhysicsEngineParameter(
            numSolverIterations=100, solverResidualThreshold=1e-12, enableFileCaching=0,
            deterministicOverlappingPairs=1, physicsClientId=c,
        )  # fmt: skip
        plane = engine.createCollisionShape(engine.GEOM_PLANE, physicsClientId=c)
        self._floor = engine.createMultiBody(0, plane, physicsClientId=c)
        engine.changeDynamics(
            self._floor, -1, lateralFriction=1.0, restitution=0.0, physicsClientId=c
        )
        with tempfile.TemporaryDirectory() as folder:
            file = Path(folder) / self._walker.urdf.name
            file.write_text(urdf, encoding="utf-8")
            flags = engine.URDF_USE_INERTIA_FROM_FILE | engine.URDF_IGNORE_VISUAL_SHAPES
            self._body = engine.loadURDF(str(file), [0, 0, 1], flags=flags, physicsClientId=c)
        self._index()

    def _index(self) -> None:
        c, body = self._client, self._body
        count = engine.getNumJoints(body, physicsClientId=c)
        about = [engine.getJointInfo(body, i, physicsClientId=c) for i in range(count)]
        number = {a[1].decode(): a[0] for a in about}
        self._links = {a[12].decode(): a[0] for a in about}
        self._links[engine.getBodyInfo(body, physicsClientId=c)[0].decode()] = -1
        self._joints = [number[j] for j in self.robot.joints]
        self._feet = {self._links[foot]: k for k, foot in enumerate(self.robot.feet)}
        for joint in [a[0] for a in about if a[2] != engine.JOINT_FIXED]:
            engine.setJointMotorControl2(
                body, joint, engine.VELOCITY_CONTROL, force=0.0, physicsClientId=c
            )
        rub = self._effects.get("coulomb_friction")
        if rub:
            engine.setJointMotorControl2(
                body, number[rub["joint"]], engine.VELOCITY_CONTROL, targetVelocity=0.0,
                force=rub["torque"], physicsClientId=c,
            )  # fmt: skip
        engine.changeDynamics(body, -1, linearDamping=0.0, angularDamping=0.0, physicsClientId=c)
        slip, soft = (self._effects.get(n, {}) for n in ("foot_friction", "ground_compliance"))
        for name, link in self._links.items():
            friction = 1.0 + (slip.get("error", 0.0) if slip.get("foot") == name else 0.0)
            values = {"lateralFriction": friction, "restitution": 0.0}
            if soft and name in self.robot.feet:
                values["contactStiffness"] = 1.0 / soft["compliance"]
                values["contactDamping"] = soft["damping"]
            engine.changeDynamics(
                body, link, activationState=engine.ACTIVATION_STATE_DISABLE_SLEEPING,
                physicsClientId=c,
            )  # fmt: skip
            engine.changeDynamics(body, link, **values, physicsClientId=c)
        inertial = engine.getDynamicsInfo(body, -1, physicsClientId=c)
        self._com, self._com_turn = np.array(inertial[3]), Rotation.from_quat(inertial[4])

    # ---- the interface of a plant

    def reset(self, seed: int | None = None) -> RobotState:
        """Stand at rest with the lowest foot on the ground."""
        c, body = self._client, self._body
        for joint, angle in zip(self._joints, self._standing, strict=True):
            engine.resetJointState(body, joint, float(angle), 0.0, physicsClientId=c)
        self._rng = np.random.default_rng([self._seed, 13])
        self._tick, self._told = 0, deque()
        self.fallen: str | None = None
        self._put(np.zeros(3))
        gaps = [
            p[8]
            for link in self._feet
            for p in engine.getClosestPoints(body, self._floor, 10.0, link, physicsClientId=c)
        ]
        self._put(np.array([0.0, 0.0, -min(gaps)]))
        self._height = self._base()[0][2]
        self._speed = np.zeros(3)
        return self._read(np.zeros(len(self._joints)), np.zeros((len(self._feet), 3)))

    def step(self, command: MotionCommand, trunk: TrunkTorque) -> RobotState:
        """Hold a command for one control period; returns the sensor readings at its end."""
        c, body, n = self._client, self._body, len(self._joints)
        self._told.append((self._tick * self._walker.steps, command, trunk))
        late = round(self._effects.get("command_delay", {"delay": 0.0})["delay"] / self._dt)
        taus, forces = np.zeros(n), np.zeros((len(self._feet), 3))
        drag = self._effects.get("trunk_drag")
        for k in range(self._walker.steps):
            tick = self._tick * self._walker.steps + k
            while len(self._told) > 1 and self._told[1][0] + late <= tick:
                self._told.popleft()
            _, target, feed = self._told[0]
            q, dq = self._moving()
            swings = ~np.repeat(np.asarray(feed.stance, bool), 3)
            kp, kd = np.where(swings, self._swing, self._stand)
            tau = kp * (target.q - q) + kd * (target.dq - dq) + feed.tau
            tau = self._strong * np.clip(tau, -self._effort, self._effort)
            tau += self._teeth(q)
            taus += tau / self._walker.steps
            engine.setJointMotorControlArray(
                body, self._joints, engine.TORQUE_CONTROL, forces=tau.tolist(), physicsClientId=c
            )
            if drag:
                at, _, velocity, _ = self._base()
                force = -drag["drag"] * velocity * float(np.linalg.norm(velocity))
                engine.applyExternalForce(
                    body, self._links[drag["link"]], force.tolist(), at.tolist(), WORLD,
                    physicsClientId=c,
                )  # fmt: skip
            engine.stepSimulation(physicsClientId=c)
            self._press(forces)
        self._tick += 1
        return self._read(taus, forces / self._walker.steps)

    def ground_truth(self) -> GroundTruth:
        """Ground truth of the base at this tick."""
        at, turn, velocity, spin = self._base()
        back = turn.inv()
        t = self._tick / self.robot.control_rate
        return GroundTruth(
            self._tick, t, at, turn.as_quat(), back.apply(velocity), back.apply(spin)
        )

    def close(self) -> None:
        """Disconnect from the engine."""
        engine.disconnect(self._client)

    # ---- parts

    def _put(self, by: np.ndarray) -> None:
        """Move the base by a displacement [m], parallel to the ground and at rest."""
        c, body = self._client, self._body
        at, _ = engine.getBasePositionAndOrientation(body, physicsClientId=c)
        turn = self._com_turn.as_quat().tolist()
        place = (np.array(at) + by).tolist()
        engine.resetBasePositionAndOrientation(body, place, turn, physicsClientId=c)
        engine.resetBaseVelocity(body, [0.0] * 3, [0.0] * 3, physicsClientId=c)

    def _moving(self) -> tuple[np.ndarray, np.ndarray]:
        rows = engine.getJointStates(self._body, self._joints, physicsClientId=self._client)
        return np.array([r[0] for r in rows]), np.array([r[1] for r in rows])

    def _base(self) -> tuple[np.ndarray, Rotation, np.ndarray, np.ndarray]:
        """Origin, attitude, velocity and angular velocity of the base in the world frame."""
        com, turn = engine.getBasePositionAndOrientation(self._body, physicsClientId=self._client)
        velocity, spin = engine.getBaseVelocity(self._body, physicsClientId=self._client)
        attitude = Rotation.from_quat(turn) * self._com_turn.inv()
        arm = attitude.apply(self._com)
        return (
            np.array(com) - arm,
            attitude,
            np.array(velocity) - np.cross(spin, arm),
            np.array(spin),
        )

    def _teeth(self, q: np.ndarray) -> np.ndarray:
        p = self._effects.get("gear_ripple")
        if not p:
            return np.zeros(len(q))
        mask = np.array([j == p["joint"] for j in self.robot.joints])
        return mask * p["torque"] * np.sin(p["teeth"] * q)

    def _press(self, forces: np.ndarray) -> None:
        """Add the current ground force on each foot [N]."""
        points = engine.getContactPoints(self._body, self._floor, physicsClientId=self._client)
        for p in points:
            if p[3] in self._feet:
                total = p[9] * np.array(p[7]) + p[10] * np.array(p[11]) + p[12] * np.array(p[13])
                forces[self._feet[p[3]]] += total

    def _read(self, tau: np.ndarray, grf: np.ndarray) -> RobotState:
        q, dq = self._moving()
        at, turn, velocity, spin = self._base()
        dt = 1.0 / self.robot.control_rate
        pull = (velocity - self._speed) / dt - self._gravity
        self._speed = velocity
        tilt = self._effects.get("imu_tilt", {"roll": 0.0, "pitch": 0.0, "yaw": 0.0})
        mount = turn * Rotation.from_euler("xyz", [tilt["roll"], tilt["pitch"], tilt["yaw"]])
        if at[2] < FAR * self._height:
            self.fallen = f"base height {at[2]:.3f} m"
        n, rng = self._walker.noise, self._rng

        def noisy(values: np.ndarray, name: str) -> np.ndarray:
            return values + self._noise * n[name] * rng.standard_normal(values.shape)

        shake = Rotation.from_rotvec(noisy(np.zeros(3), "attitude"))
        back = mount.inv()
        return RobotState(
            tick=self._tick, t=self._tick * dt, q=noisy(q, "q"), dq=noisy(dq, "dq"),
            tau=noisy(tau, "tau"), grf=noisy(grf, "grf"),
            orientation=(self._level * mount * shake).as_quat(),
            angular_velocity=noisy(back.apply(spin), "gyro"),
            linear_acceleration=noisy(back.apply(pull), "force"),
            contact=np.linalg.norm(grf, axis=1) > TOUCH,
        )  # fmt: skip
