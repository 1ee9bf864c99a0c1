# SPDX-License-Identifier: Apache-2.0
"""Rigid bodies of a machine in MuJoCo; the only module of the battery that uses this engine.

The search predicts fixed-base robots with loco's own equations and does not use MuJoCo for
them. This module uses nothing of `loco_sim`, neither its world nor its URDF reader; otherwise
generator and workflow would share their errors.

The integrator is leapfrog: velocities are half a step before positions. The error is
proportional to the square of the step if velocity-dependent torques use the velocity at the
time of the positions.
"""

from __future__ import annotations

import ctypes
from typing import Any

import llvmlite.binding
import mujoco
import numpy as np
from mujoco import _functions
from numba import types

from .tree import Tree

RIGID = (0.9999, 0.9999, 0.001, 0.5, 2.0)  # solimp of stops and dry friction, nearly rigid
DEAD_STOP = 10.0  # damping ratio of stops: no rebound
NO_LIMIT = 1e3  # [rad or m] in place of infinity


def _compiled(name: str, *arguments: Any) -> types.ExternalFunction:
    """A function of the engine's library for calls from compiled code; pointers are integers."""
    symbol = f"loco_battery_{name}"
    library = ctypes.CDLL(_functions.__file__)  # extension module linked to the library
    llvmlite.binding.add_symbol(symbol, ctypes.cast(library[name], ctypes.c_void_p).value)
    return types.ExternalFunction(symbol, types.void(*arguments))


pointer = types.intp
take_step = _compiled("mj_step", pointer, pointer)  # model and data
apply_force = _compiled(  # model, data, force, torque, point, body, output torques
    "mj_applyFT", pointer, pointer, pointer, pointer, pointer, types.int32, pointer
)


class Engine:
    """A kinematic tree with a fixed root, driven by joint torques.

    Attributes:
        q: Joint positions [rad], (n,).
        v: Joint velocities half a step earlier [rad/s], (n,).
        a: Joint accelerations over the last step [rad/s²], (n,).
        tau: Joint torques, to be set before each step [N·m], (n,).
        friction: Dry friction of the joints, to be set before each step [N·m], (n,).
        places: Origins of the bodies' frames in the world [m], (bodies, 3).
        turns: Rotation matrices of the bodies, body to world, row-major, (bodies, 9).
        pointers: Pointers to model and data, for `take_step` and `apply_force`.
    """

    def __init__(self, tree: Tree, dt: float, gravity: float):
        spec = mujoco.MjSpec()
        spec.compiler.degree = False
        spec.option.timestep, spec.option.gravity = dt, (0.0, 0.0, -gravity)
        spec.option.tolerance, spec.option.iterations = 1e-12, 50
        spec.option.disableflags |= mujoco.mjtDisableBit.mjDSBL_AUTORESET  # keep divergence
        bodies = []
        for i, (joint, link) in enumerate(zip(tree.joints, tree.links, strict=True)):
            above = bodies[tree.parent[i]] if tree.parent[i] >= 0 else spec.worldbody
            body = above.add_body(name=link, pos=tree.place[i], quat=_quaternion(tree.turn[i]))
            slides = mujoco.mjtJoint.mjJNT_SLIDE, mujoco.mjtJoint.mjJNT_HINGE
            body.add_joint(
                name=joint, type=slides[0] if tree.slides[i] else slides[1], axis=tree.axis[i],
                armature=tree.armature[i], limited=True,
                range=np.clip((tree.lower[i], tree.upper[i]), -NO_LIMIT, NO_LIMIT),
            )  # fmt: skip
            inertia = tree.inertia[i]
            body.mass, body.ipos, body.explicitinertial = tree.mass[i], tree.com[i], True
            body.fullinertia = [*np.diag(inertia), inertia[0, 1], inertia[0, 2], inertia[1, 2]]
            bodies.append(body)
        self._model = spec.compile()
        m, self._data = self._model, mujoco.MjData(self._model)
        if [m.joint(name).id for name in tree.joints] != list(range(len(tree.joints))):
            raise ValueError(f"joints must be listed depth first, got {', '.join(tree.joints)}")
        m.dof_solref[:] = 2.0 * dt, 1.0
        m.jnt_solref[:] = 2.0 * dt, DEAD_STOP
        m.dof_solimp[:] = m.jnt_solimp[:] = RIGID
        self.bodies = [m.body(link).id for link in tree.links]
        d = self._data
        self.places, self.turns, self.pointers = d.xpos, d.xmat, (m._address, d._address)
        self.q, self.v, self.a = d.qpos, d.qvel, d.qacc
        self.tau, self.friction = d.qfrc_applied, m.dof_frictionloss

    def mass(self, q: np.ndarray) -> np.ndarray:
        """Mass matrix at joint positions [kg·m²], (n, n)."""
        self.q[:], self.v[:] = q, 0.0
        mujoco.mj_forward(self._model, self._data)
        full = np.zeros((len(q), len(q)))
        mujoco.mj_fullM(self._model, self._data, full)
        return full

    def needed(self, q: np.ndarray, v: np.ndarray, a: np.ndarray) -> np.ndarray:
        """Inverse dynamics: torques for a motion, without stops and friction [N·m], (n,)."""
        full = self.mass(q)
        self.v[:] = v
        mujoco.mj_forward(self._model, self._data)
        return full @ a + self._data.qfrc_bias

    def energy(self) -> float:
        """Kinetic and potential energy with the current (half-step) velocities [J]."""
        mujoco.mj_energyPos(self._model, self._data)
        mujoco.mj_energyVel(self._model, self._data)
        return float(self._data.energy.sum())


def _quaternion(turn: np.ndarray) -> np.ndarray:
    out = np.zeros(4)
    mujoco.mju_mat2Quat(out, turn.ravel())
    return out
