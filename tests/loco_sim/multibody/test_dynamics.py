# SPDX-License-Identifier: Apache-2.0
"""Equations of motion, beside those of an engine that nobody here wrote, and by their laws."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from loco_sim import lazy
from loco_sim.multibody import dynamics, tree
from loco_sim.robot.description import Description

from ...quadrupeds import DATA
from ..trees import random_urdf

bullet = lazy.module("loco_sim.world.bullet")  # loads the engine, which not everyone has

GRAVITY = np.array([0.4, -1.1, -9.3])
SEEDS = range(5)
# Robots whose links all have a mass.
FOREIGN = ("kuka_iiwa/model.urdf", "a1/a1.urdf", "racecar/racecar.urdf", "r2d2.urdf")


def equations(made: tree.Tree, q, dq, gravity=GRAVITY) -> tuple[np.ndarray, np.ndarray]:
    """Mass matrix and bias torques in the order of the tree."""
    n = len(made.kin)
    room, bias = dynamics.workshop(n), np.zeros(n)
    dynamics.dynamics(made, gravity, np.asarray(q, float), np.asarray(dq, float), *room[:2], bias)
    return room[1].copy(), bias


def state(count: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
    rng = np.random.default_rng([seed, 1])
    return rng.uniform(-0.5, 0.5, count), rng.uniform(-2.0, 2.0, count)


class Engine:
    """PyBullet's inverse dynamics of a bolted URDF."""

    def __init__(self, path: Path):
        self._p = bullet.pybullet
        self._client = self._p.connect(self._p.DIRECT)
        self._p.setGravity(*GRAVITY, physicsClientId=self._client)
        flags = self._p.URDF_USE_INERTIA_FROM_FILE | self._p.URDF_IGNORE_VISUAL_SHAPES
        self._body = self._p.loadURDF(
            str(path), useFixedBase=True, flags=flags, physicsClientId=self._client
        )
        count = self._p.getNumJoints(self._body, physicsClientId=self._client)
        about = [
            self._p.getJointInfo(self._body, k, physicsClientId=self._client) for k in range(count)
        ]
        self.joints = tuple(a[1].decode() for a in about if a[2] != self._p.JOINT_FIXED)

    def torques(self, q, dq, ddq) -> np.ndarray:
        given = [np.asarray(x, float).tolist() for x in (q, dq, ddq)]
        answer = self._p.calculateInverseDynamics(self._body, *given, physicsClientId=self._client)
        return np.array(answer)

    def close(self) -> None:
        self._p.disconnect(self._client)


@pytest.fixture
def engine():
    """Function that loads a URDF."""
    loaded = []

    def load(path: Path) -> Engine:
        loaded.append(Engine(path))
        return loaded[-1]

    yield load
    for one in loaded:
        one.close()


def as_the_engine_says(engine: Engine, urdf: str, seed: int) -> None:
    made, order, _ = tree.build(Description(urdf), engine.joints)
    q, dq = state(len(engine.joints), seed)
    ddq = np.random.default_rng(seed).uniform(-3.0, 3.0, len(q))
    matrix, bias = equations(made, q[order], dq[order])
    torques = np.empty(len(q))
    torques[order] = matrix @ ddq[order] + bias
    said = engine.torques(q, dq, ddq)
    assert torques == pytest.approx(said, rel=1e-5, abs=1e-5 * np.abs(said).max())


@pytest.mark.pybullet
@pytest.mark.parametrize("seed", SEEDS)
def test_torques_of_any_tree_are_those_of_the_engine(engine, tmp_path, seed):
    path = tmp_path / "random.urdf"
    path.write_text(random_urdf(seed)[0], encoding="utf-8")
    as_the_engine_says(engine(path), path.read_text(encoding="utf-8"), seed)


@pytest.mark.pybullet
@pytest.mark.parametrize("name", FOREIGN)
def test_torques_of_robots_of_others_are_those_of_the_engine(engine, name):
    path = DATA / name
    as_the_engine_says(engine(path), path.read_text(encoding="utf-8"), 3)


@pytest.mark.parametrize("seed", SEEDS)
def test_torques_of_a_motion_are_those_of_its_rows(seed):
    """Inertia, bias without weight, and the weight by each component of gravity."""
    made, _, _ = tree.build(Description((given := random_urdf(seed))[0]), given[1])
    rows, n = 3, len(made.kin)
    q, dq, ddq = np.random.default_rng(seed).uniform(-1.0, 1.0, (3, rows, n))
    moved, held = np.empty((rows, n)), np.empty((rows, n, 3))
    dynamics.needed(made, q, dq, ddq, *dynamics.workshop(n)[:2], moved, held)
    for t in range(rows):
        matrix, bias = equations(made, q[t], dq[t])
        assert moved[t] + held[t] @ GRAVITY == pytest.approx(matrix @ ddq[t] + bias, abs=1e-12)


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("free", [False, True])
def test_a_mass_matrix_is_symmetric_and_nothing_moves_for_free(seed, free):
    made, _, _ = tree.build(Description((given := random_urdf(seed))[0]), given[1], free)
    q, dq = state(len(made.kin), seed)
    matrix, _ = equations(made, q, dq)
    assert matrix == pytest.approx(matrix.T)
    assert np.linalg.eigvalsh(matrix)[0] > 0.0
    assert equations(made, q, 3.0 * dq)[0] == pytest.approx(matrix)  # speed changes no mass


@pytest.mark.parametrize("seed", SEEDS)
def test_what_moves_a_free_base_is_the_mass_of_all(seed):
    urdf, joints = random_urdf(seed)
    made, _, _ = tree.build(Description(urdf), joints, free=True)
    n, mass = len(made.kin), made.body[:, tree.MASS].sum()
    matrix, bias = equations(made, state(n, seed)[0], np.zeros(n))
    assert matrix[:3, :3] == pytest.approx(mass * np.eye(3))
    assert bias[:3] == pytest.approx(-mass * GRAVITY)


@pytest.mark.parametrize("seed", SEEDS)
def test_power_of_the_bias_is_the_change_of_energy(seed):
    """Along a motion: dT/dt of T = dq' M dq / 2 is dq' (torque - bias) without gravity."""
    urdf, joints = random_urdf(seed)
    made, _, _ = tree.build(Description(urdf), joints)
    q, dq = state(len(joints), seed)
    still = np.zeros(3)

    def energy(t: float) -> float:
        return 0.5 * dq @ equations(made, q + t * dq, dq, still)[0] @ dq

    _, bias = equations(made, q, dq, still)
    rate = (energy(1e-5) - energy(-1e-5)) / 2e-5
    assert dq @ bias == pytest.approx(rate, rel=1e-5, abs=1e-8)  # with no acceleration


@pytest.mark.parametrize("seed", SEEDS)
@pytest.mark.parametrize("free", [False, True])
def test_factor_and_solution_are_those_of_the_matrix(seed, free):
    urdf, joints = random_urdf(seed, 9)
    made, _, _ = tree.build(Description(urdf), joints, free)
    n = len(made.kin)
    matrix, _ = equations(made, *state(n, seed))
    factor = np.tril(matrix)
    dynamics.factorise(made.kin, factor)
    lower = np.tril(factor)
    assert lower.T @ lower == pytest.approx(matrix)
    wanted = np.random.default_rng(seed).normal(size=(2, n))
    rows = wanted.copy()
    dynamics.solve(made.kin, factor, rows, 1)
    assert matrix @ rows[1] == pytest.approx(wanted[1])
    assert rows[0].tolist() == wanted[0].tolist()


def test_a_rotor_is_on_its_own_joint_alone():
    urdf, joints = random_urdf(1)
    made, order, _ = tree.build(Description(urdf), joints)
    rotors = dict.fromkeys(joints, 0.0) | {joints[0]: 0.3}
    felt = tree.geared(made, order, joints, rotors)
    q, dq = state(len(joints), 1)
    (bare, push), (with_rotor, same) = equations(made, q, dq), equations(felt, q, dq)
    extra = np.diag(0.3 * (order == 0))
    assert with_rotor - bare == pytest.approx(extra) and same == pytest.approx(push)
