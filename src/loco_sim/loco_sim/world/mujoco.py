# SPDX-License-Identifier: Apache-2.0
"""The plant's world in MuJoCo.

Peculiarities of MuJoCo that this module hides:
    * links without a joint are merged into their parents by default;
    * quaternions are w x y z, and the angular velocity of a free body is in its own frame;
    * frames of links are those of the start of the last step until recomputed;
    * the larger friction of two surfaces applies, so the ground has friction 0;
    * a contact is a spring and damper whose constants are scaled by the inverse mass of what
      touches: `_softness` takes that scale out again.
"""

from __future__ import annotations

import ctypes
from collections.abc import Callable, Iterable, Sequence
from copy import copy
from functools import cache
from pathlib import Path

import mujoco
import numpy as np

from loco_control.exceptions import DivergedError, ParameterError

from ..geometry import Triple, rotate, rotate_back, rotation_matrix
from . import hinges, world
from .mujoco_model import body_of, compiled, dates, link_of, lowest_point, plan
from .world import Base, Handles

RIGID = (0.95, 0.99, 0.001, 0.5, 2.0)  # MuJoCo's solimp of rigid contacts
STOP = (0.9999, 0.9999, 0.001, 0.5, 2.0)  # solimp of joint stops and dry friction, nearly rigid
IMPEDANCE_MARGIN = 1e-4  # distance of contact impedances from 0 and 1 that MuJoCo enforces
IMPEDANCE_RATIO = 10.0  # stiffness of friction constraints / normal rigid constraints
LIBRARIES = "libmujoco.", "mujoco.dll"  # the engine's library in the folder of its Python module
BAD = int(mujoco.mjtWarning.mjWARN_BADQACC)
QUIET = 1  # initial count of warnings, since MuJoCo prints the first one


class World(world.World):
    """A world with its own MuJoCo model."""

    # ---- building ----------------------------------------------------------------

    def rebuild(
        self,
        q: Sequence[float],
        configure: Iterable[Callable[[World], None]] = (),
        height: float | None = None,
    ) -> None:
        super().rebuild(q, configure, height)
        m = self._model
        initial = self._data.qpos, m.geom_friction, m.body_pos, m.body_quat
        self._built = tuple(values.copy() for values in initial)

    def restore(self) -> bool:
        m, d = self._model, self._data
        mujoco.mj_resetData(m, d)
        d.warning.number[:] = QUIET
        d.qpos[:], m.geom_friction[:], m.body_pos[:], m.body_quat[:] = self._built
        m.dof_frictionloss[:] = 0.0
        self._has_brakes = self._has_forces = self._is_current = False
        return True

    def _load(self, height: float) -> None:
        text = self._urdf
        root = "" if self.robot.fixed_base else self.description.root_link()
        self._model_key = (
            text, dates(text), root, self.robot.feet, self.dt, tuple(self.pull),
            self.params.solver_iterations, self.terrain,
        )  # fmt: skip
        try:
            model = compiled(*self._model_key)
        except ValueError as error:
            raise ParameterError(
                f"MuJoCo cannot build robot {self.robot.name!r}: {' '.join(str(error).split())}"
            ) from None
        self._model = copy(model)
        self._data = mujoco.MjData(self._model)
        self._data.warning.number[:] = QUIET
        self._index()
        self._set_contacts()
        self._data.qpos[:] = self._model.qpos0
        self._lift(height)

    def _index(self) -> None:
        """Look up joints and links by name; joint friction is left to effects."""
        m = self._model
        self._bodies = {link_of(m.body(i).name): i for i in range(1, m.nbody)}
        by_name = {m.joint(i).name: i for i in range(m.njnt)}
        hinges = [m.body_jntadr[self._bodies[link]] for link in self.hinges]
        joints = [by_name[name] for name in self.robot.joints] + hinges
        self._at, self._dof = m.jnt_qposadr[joints], m.jnt_dofadr[joints]
        n = len(self.robot.joints)
        self._q_at, self._dq_at = self._at[:n], self._dof[:n]
        self._root = self._bodies[self.description.root_link()]
        self._fastest = self.description.fastest()
        m.dof_frictionloss[:] = 0.0
        for joint, inertia in self.armature.items():
            m.dof_armature[m.jnt_dofadr[by_name[joint]]] = inertia
        if self.armature:
            mujoco.mj_setConst(m, self._data)
        m.dof_solref[:] = m.jnt_solref[:] = 2.0 * self.dt, 1.0  # as stiff as the step allows
        m.dof_solimp[:] = m.jnt_solimp[:] = STOP
        self._has_brakes = self._has_forces = False
        self._is_current = False

    def _set_contacts(self) -> None:
        """Set friction and compliance of every link.

        Soft ground is compliant along its normal only: MuJoCo would also soften friction, and
        feet would creep. Friction is at least as stiff as on rigid ground.
        """
        m, p = self._model, self.params
        for name in self._bodies:
            m.geom_condim[self.shapes(name)] = 3
            self.set_friction(name, self.friction.get(name, p.friction))
            self.set_softness(name, *self.softness(name))

    def set_softness(self, link: str, stiffness: float, damping: float) -> None:
        m, at = self._model, self.shapes(link)
        soft = self._softness(self._bodies[link], (stiffness, damping))
        m.geom_solref[at], m.geom_solimp[at] = soft
        softest = min(RIGID[0], m.geom_solimp[m.geom_bodyid > 0, 0].min(initial=1.0))
        m.opt.impratio = IMPEDANCE_RATIO * (1.0 / softest - 1.0) / (1.0 / RIGID[0] - 1.0)

    def _softness(self, body: int, soft: tuple[float, float]) -> tuple:
        """MuJoCo's solref and solimp of a link with compliant or rigid contacts.

        A contact of inverse mass w and constant impedance d obeys, with solref (-s, -b),
        f = -(s r + b v) / (w (1 - d)) - a d / (w (1 - d)). A spring K and a damper D that
        are integrated implicitly, f = -K (r + dt v + dt² a) - D (v + dt a), are of that form.
        """
        if soft[0] <= 0.0:
            return (2.0 * self.dt, 1.0), RIGID
        stiffness, damping = soft[0], soft[1] + self.dt * soft[0]
        weight = max(float(self._model.body_invweight0[body, 0]), 1e-9)
        share = weight * self.dt * damping
        impedance = min(max(share / (1.0 + share), IMPEDANCE_MARGIN), 1.0 - IMPEDANCE_MARGIN)
        scale = weight * (1.0 - impedance)
        solimp = impedance, impedance, 0.001, 0.5, 2.0
        return (-scale * stiffness, -scale * damping), solimp

    def _lowest_foot(self) -> float:
        points = self.lowest_points()
        return min(points[f][2] if f in points else self.place(f)[2] for f in self.robot.feet)

    def lowest_points(self) -> dict[str, Triple]:
        """Lowest point of each collision link, world frame [m]; of convex hulls for meshes."""
        self._update_kinematics()
        lowest: dict[str, Triple] = {}
        for link, body in self._bodies.items():
            geoms = np.flatnonzero(self._model.geom_bodyid == body)
            points = [lowest_point(self._model, self._data, geom) for geom in geoms]
            if points:
                lowest[link] = min(points, key=lambda point: point[2])
        return lowest

    def _lift(self, height: float) -> None:
        """Set the height of the base [m]."""
        if self.robot.fixed_base:
            self._model.body_pos[self._root, 2] = height
        else:
            self._data.qpos[2] = height
        self._is_current = False

    _raise = _lift

    def _place(self, q: Sequence[float]) -> None:
        self._data.qpos[self._q_at] = q
        self._data.qvel[self._dq_at] = 0.0
        self._is_current = False

    def put(self, q: Sequence[float], dq: Sequence[float], base: Base | None = None) -> None:
        if base:
            self.pose(base.position, base.orientation, q)
            if not self.robot.fixed_base:
                turn = rotation_matrix(base.orientation)
                self._data.qvel[:3] = base.velocity
                self._data.qvel[3:6] = rotate_back(turn, base.angular_velocity)
        self._data.qpos[self._q_at] = q
        self._data.qvel[self._dq_at] = dq
        self._is_current = False

    def pose(self, position: Triple, orientation: Sequence[float], q: Sequence[float]) -> None:
        """Set the pose of the base frame and the joint positions, at rest."""
        x, y, z, w = orientation
        if self.robot.fixed_base:
            self._model.body_pos[self._root] = position
            self._model.body_quat[self._root] = w, x, y, z
        else:
            self._data.qpos[:3] = position
            self._data.qpos[3:7] = w, x, y, z
        self._place(q)

    # ---- one physics step --------------------------------------------------------

    def step(self, tau: Sequence[float]) -> None:
        """Apply joint torques [N·m], (n,), and advance one physics step.

        Raises:
            DivergedError: The state is no longer finite.
        """
        self._apply(tau)
        mujoco.mj_step(self._model, self._data)
        self._finish_step()

    def _apply(self, tau: Sequence[float]) -> None:
        """Apply joint torques, and spring torques of hinges."""
        if self.hinges:
            springs = zip(self.hinges.values(), self._flex_states, self._hinged, strict=True)
            tau = [*tau, *(hinges.torque(*spring, self.dt) for spring in springs)]
        self._data.qfrc_applied[self._dof] = tau

    def damped_step(self, tau: Sequence[float], law: np.ndarray) -> tuple:
        """As `world.World.damped_step`; implicit damping is represented as an inertia kd dt.

        (M + dt D) a = tau - D v + ... is M a = tau - D (v + dt a) + ..., for contacts as well.
        Drives that exceed their limit are set to the limit, and the step is solved again.

        Raises:
            DivergedError: The state is no longer finite.
        """
        target, gain, limit, passive = law
        m, data, at = self._model, self._data, self._dq_at
        before, armature, diagonal = data.qvel[at], m.dof_armature[at], m.dof_M0[at]
        saturated = np.full(len(at), np.nan)  # torque of the drives at their limit
        while True:
            free = np.isnan(saturated)
            slope = np.where(free, gain, 0.0) + passive
            drive = np.where(free, target, saturated)
            self._apply((tau + drive - slope * before).tolist())
            m.dof_armature[at] = armature + self.dt * slope
            m.dof_M0[at] = diagonal + self.dt * slope  # used for joints with constant inertia
            mujoco.mj_forward(m, data)
            torque = target - gain * (before + self.dt * data.qacc[at])
            over = free & (np.abs(torque) > limit)
            if not over.any():
                break
            saturated[over] = np.copysign(limit, torque)[over]
        mujoco.mj_checkAcc(m, data)
        mujoco.mj_implicit(m, data)
        m.dof_armature[at], m.dof_M0[at] = armature, diagonal
        self._finish_step()
        after = data.qvel[at]
        return np.where(free, np.clip(target - gain * after, -limit, limit), saturated), after

    def _finish_step(self) -> None:
        """Common actions after each step."""
        data = self._data
        self._is_current = False
        if self._has_forces:
            data.xfrc_applied[:] = 0.0
            self._has_forces = False
        if np.max(np.abs(data.qvel), initial=0.0) > self._fastest:  # as PyBullet does
            data.qvel[:] = data.qvel.clip(-self._fastest, self._fastest)
        if data.warning[BAD].number != QUIET:
            raise DivergedError(f"the physics diverged at t = {data.time:.3f} s (MuJoCo)")

    def brake(self, budget: np.ndarray, dq: np.ndarray) -> None:
        if self._has_brakes or budget.any():
            self._model.dof_frictionloss[self._dq_at] = budget
            self._has_brakes = True

    def set_friction(self, link: str, friction: float) -> None:
        self._model.geom_friction[self.shapes(link), 0] = friction

    def joint_states(self) -> tuple[list[float], list[float]]:
        q, dq = self._data.qpos[self._at].tolist(), self._data.qvel[self._dof].tolist()
        if self.hinges:
            n = len(self.robot.joints)
            self._flex_states = list(zip(q[n:], dq[n:], strict=True))
            return q[:n], dq[:n]
        return q, dq

    def add_ground_forces(self, total: list[float]) -> None:
        for i, force in enumerate(self._data.sensordata.tolist()):
            total[i] += force

    def base(self) -> Base:
        m, data = self._model, self._data
        if self.robot.fixed_base:
            w, x, y, z = m.body_quat[self._root].tolist()
            zero = (0.0, 0.0, 0.0)
            return Base(tuple(m.body_pos[self._root].tolist()), (x, y, z, w), zero, zero)
        px, py, pz, w, x, y, z = data.qpos[:7].tolist()
        vx, vy, vz, *spin = data.qvel[:6].tolist()
        spin = rotate(rotation_matrix((x, y, z, w)), spin)
        return Base((px, py, pz), (x, y, z, w), (vx, vy, vz), spin)

    def push(
        self,
        force: Sequence[float],
        link: str | None = None,
        point: Sequence[float] = (0, 0, 0),
        at: Triple | None = None,
    ) -> None:
        body = self._root if link is None else self._bodies[link]
        at = self.place(link, point) if at is None else at
        self._update_kinematics()
        arm = np.subtract(at, self._data.xipos[body])
        self._data.xfrc_applied[body, :3] += force
        self._data.xfrc_applied[body, 3:] += np.cross(arm, force)
        self._has_forces = True

    def place(self, link: str | None, offset: Sequence[float] = (0.0, 0.0, 0.0)) -> Triple:
        self._update_kinematics()
        body = self._root if link is None else self._bodies[link]
        x, y, z = self._data.xpos[body].tolist()
        ox, oy, oz = rotate(self._data.xmat[body].tolist(), offset)
        return x + ox, y + oy, z + oz

    # ---- for a compiled loop -----------------------------------------------------

    def handles(self) -> Handles | None:
        m, d, n = self._model, self._data, len(self.robot.joints)
        if not (library := _library()):
            return None
        step, poses = (_address(library, name) for name in ("mj_step", "mj_kinematics"))
        base = np.concatenate(self.base()) if self.robot.fixed_base else np.zeros(0)
        return Handles(
            step, poses, m._address, d._address, d.qpos, d.qvel, d.qfrc_applied, m.dof_frictionloss,
            d.xfrc_applied, m.geom_friction, d.sensordata, d.xpos, d.xmat, d.xipos, self._q_at,
            self._dq_at, self._at[n:], self._dof[n:], base, d.warning.number[BAD : BAD + 1], QUIET,
            self._fastest, self.params.grf == "mean",
        )  # fmt: skip

    def frames(self) -> dict[str | None, tuple[int, np.ndarray, np.ndarray]]:
        bodies = {None: self._root, **self._bodies}
        return {link: (body, np.zeros(3), np.eye(3)) for link, body in bodies.items()}

    def shapes(self, link: str) -> list[int]:
        return np.flatnonzero(self._model.geom_bodyid == self._bodies[link]).tolist()

    def moved(self) -> None:
        self._is_current = False

    def _update_kinematics(self) -> None:
        """Compute the frames of all links at the current state, once per step."""
        if not self._is_current:
            mujoco.mj_kinematics(self._model, self._data)
            self._is_current = True

    # ---- rarely used-----------------------------------------------

    def mjcf(self) -> str:
        """The world after `rebuild` as MJCF, with absolute paths of meshes."""
        m, spec = self._model, plan(*self._model_key)
        for name, body in self._bodies.items():
            element = spec.body(body_of(name))
            at = np.flatnonzero(m.geom_bodyid == body)
            for geom, i in zip(element.geoms, at, strict=True):
                geom.friction, geom.condim = m.geom_friction[i], int(m.geom_condim[i])
                geom.solref, geom.solimp = m.geom_solref[i], m.geom_solimp[i]
            for joint in element.joints:
                joint.solref_limit = joint.solref_friction = 2.0 * self.dt, 1.0
                joint.solimp_limit = joint.solimp_friction = STOP
        spec.body(body_of(self.description.root_link())).pos = m.body_pos[self._root]
        spec.add_key(name="standing", qpos=self._data.qpos.tolist())
        return spec.to_xml()

    def energy(self) -> tuple[float, float]:
        m, data = self._model, self._data
        mass = self._mass(data)
        potential = -float(m.body_mass @ (data.xipos @ np.array(self.pull)))
        return potential, 0.5 * float(data.qvel @ mass @ data.qvel)

    def _mass_matrix(self, q: Sequence[float]) -> world.MassMatrix:
        data = mujoco.MjData(self._model)
        data.qpos[:] = self._data.qpos
        data.qpos[self._q_at] = q
        base = 0 if self.robot.fixed_base else 6
        n = len(self.robot.joints)
        return self._mass(data), self._dof[:n].tolist(), list(range(base)), self._dof[n:].tolist()

    def _mass(self, data: mujoco.MjData) -> np.ndarray:
        """Joint-space mass matrix of a state, (nv, nv)."""
        mujoco.mj_kinematics(self._model, data)
        mujoco.mj_comPos(self._model, data)
        mujoco.mj_crb(self._model, data)
        mass = np.zeros((self._model.nv, self._model.nv))
        mujoco.mj_fullM(self._model, data, mass)
        return mass


@cache
def _library() -> str:
    """Path of the library loaded by MuJoCo's module; "" if it is not found."""
    folder = sorted(Path(mujoco.__file__).parent.iterdir())
    return next((str(path) for path in folder if path.name.startswith(LIBRARIES)), "")


@cache
def _address(library: str, name: str) -> int:
    """Address of a C function."""
    return ctypes.cast(getattr(ctypes.CDLL(library), name), ctypes.c_void_p).value
