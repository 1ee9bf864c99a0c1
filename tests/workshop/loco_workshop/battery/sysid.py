# SPDX-License-Identifier: Apache-2.0
"""Baseline with MuJoCo's system identification, ``mujoco.sysid``, and all its parameters.

It identifies the model exported by `loco export-model --to mjcf` with rigid gears from the same
records: armature, damping and dry friction of each joint, both gains and the zero position of
each drive, mass and centre of mass of each moving body, bias and gain of each encoder, one delay.
"""

from __future__ import annotations

import io
import math
from collections.abc import Callable
from typing import Any

import mujoco
import numpy as np
from mujoco import sysid as mujoco_sysid

from loco_bringup.export_model import replay
from loco_control.exceptions import MissingPackageError
from loco_learning.gap.prediction import running
from loco_learning.gap.prediction.case import Case
from loco_learning.gap.statistics import evidence
from loco_sim.export.mjcf import mjcf
from loco_sim.export.portable import RIGID, portable
from loco_sim.plant.model import Model

ITERATIONS, EVALUATIONS = (5, 20), 1000  # of its least squares, and largest number of simulations
RATE = 4000.0  # smallest rate of physics steps [Hz]; its error is below most gaps
INSIDE = 0.01  # distance of initial values from a bound, as share of the range
FACTOR, RANGE, ZERO = 4.0, 0.2, 0.3  # bounds: gains and masses; encoders; zeros and centres
LATEST = 0.02  # longest delay [s]
SENSORS = {"q": "mjSENS_JOINTPOS", "tau": "mjSENS_JOINTACTFRC"}


def installed() -> bool:
    """Whether its required packages are installed."""
    return hasattr(mujoco_sysid, "build_residual_fn")


def require() -> None:
    """Raise `MissingPackageError` if a required package is not installed."""
    if not installed():
        raise MissingPackageError(
            "the baseline sysid needs packages that are not installed; they come with "
            "`./loco install battery`"
        )


def identify(case: Case, model: Model, seed: int) -> tuple[dict[str, list[float]], float]:
    """Identified parameter values, and the whitened rms of their residuals on held-out records.

    Args:
        case: Records to fit and held-out records, with their noise floors.
        model: Initial model.
        seed: Unused, since the method is deterministic.
    """
    task = _Task(case, model)
    fitted = task.identified()
    misfit = task.left(fitted)
    return {name: values.value.tolist() for name, values in fitted.items()}, case.judged(misfit).rms


class _Task:
    """Model, records and parameters in the format of ``mujoco.sysid``."""

    def __init__(self, case: Case, model: Model):
        require()
        self.case = case
        self.made = portable(model, RIGID)
        every = case.forward.channels
        self.columns = [i for i, channel in enumerate(every) if channel.signal in SENSORS]
        self.channels = [every[i] for i in self.columns]
        self.dt = running.period(case.records[0])
        self.steps = math.ceil(self.dt * max(RATE, self.made.robot.sim.physics_rate) - 0.01)
        self.spec = self._spec(mjcf(self.made)[0])
        self.model = self.spec.compile()

    def _spec(self, text: str) -> Any:
        """The exported model with an ideal sensor for each channel."""
        spec = mujoco.MjSpec.from_string(text)
        spec.option.timestep = self.dt / self.steps
        for channel in self.channels:
            spec.add_sensor(
                name=f"{channel.signal}_{channel.name}", objname=channel.name,
                type=getattr(mujoco.mjtSensor, SENSORS[channel.signal]),
                objtype=mujoco.mjtObj.mjOBJ_JOINT,
            )  # fmt: skip
        return spec

    def identified(self) -> Any:
        """All parameters at the values of the best fit."""
        weights = 1.0 / self.case.floor[self.columns]
        residual = mujoco_sysid.build_residual_fn(
            models_sequences=[self._sequence(i) for i in self.case.fitted],
            modify_residual=self._residual(weights), n_threads=1,
        )  # fmt: skip
        initial = self._parameters().move_off_bounds(INSIDE)
        rounds = int(np.clip(EVALUATIONS // initial.size, *ITERATIONS))
        return mujoco_sysid.optimize(
            initial, residual, "mujoco", verbose=False, max_iters=rounds, x_scale="jac",
            output=io.StringIO(),
        )[0]  # fmt: skip

    def left(self, found: Any) -> list[np.ndarray]:
        """Residuals of all records [floors], (T, C) each."""
        left = []
        for i, record in enumerate(self.case.records):
            (played,) = mujoco_sysid.sysid_rollout(
                mujoco_sysid.apply_param_modifiers(found, self.spec.copy()),
                mujoco.MjData(self.model), self._control(i), self._start(i),
            )  # fmt: skip
            predicted = np.full((len(record.t), len(self.case.forward.channels)), np.nan)
            predicted[:, self.columns] = self._read(found, played.sensordata.data)
            left += evidence.whiten(
                [self.case.forward.measured[i]], [predicted], self.case.floors[i]
            )
        return left

    def _sequence(self, i: int) -> Any:
        """A record as initial state, commands and measurements."""
        measured = self.case.forward.measured[i][:, self.columns]
        measured = np.where(self.case.fit_rows[i][:, None], measured, np.nan)
        times = self.dt * np.arange(len(measured))
        series = mujoco_sysid.TimeSeries(times, measured)
        return mujoco_sysid.ModelSequences(
            f"record_{i}", self.spec, f"record_{i}", self._start(i), self._control(i), series
        )

    def _control(self, i: int) -> Any:
        """Commands at each physics step, held or linearly interpolated between samples."""
        inputs = running.sequence(self.case.records[i], self.made.robot)
        table = replay.commands(self.made, inputs)
        rows = np.arange(len(table) * self.steps)
        share = (rows % self.steps / self.steps)[:, None] * float(any(inputs.ramps))
        current = rows // self.steps
        after = np.minimum(current + 1, len(table) - 1)
        values = (1.0 - share) * table[current] + share * table[after]
        return mujoco_sysid.TimeSeries(rows * self.dt / self.steps, values)

    def _start(self, i: int) -> np.ndarray:
        """Initial state of a record."""
        robot = self.made.robot
        q, dq = replay.initial_state(self.case.records[i], robot, self.case.forward, i)
        data = mujoco.MjData(self.model)
        for name, angle, speed in zip(robot.joints, q, dq, strict=True):
            joint = self.model.joint(name)
            data.qpos[joint.qposadr[0]], data.qvel[joint.dofadr[0]] = angle, speed
        kind = mujoco.mjtState.mjSTATE_FULLPHYSICS
        state = np.empty(mujoco.mj_stateSize(self.model, kind))
        mujoco.mj_getState(self.model, data, state, kind)
        return state

    def _read(self, found: Any, sensed: np.ndarray) -> np.ndarray:
        """Sensor readings with the sensors' errors at each sample, (T, C).

        A row of `sensed` is the state before its physics step; torques are means since the last
        sample.
        """
        rows = np.arange(0, len(sensed), self.steps)
        times = rows - found["delay"].value[0] / self.model.opt.timestep
        readings, grid = np.empty((len(rows), len(self.channels))), np.arange(len(sensed) + 1)
        for k, channel in enumerate(self.channels):
            if channel.signal == "tau":
                sums = np.concatenate([[0.0], np.cumsum(sensed[:, k])])
                integrals = (np.interp(at, grid, sums) for at in (times, times - self.steps))
                readings[:, k] = np.subtract(*integrals) / self.steps
            else:
                bias, gain = found[f"encoder_{channel.name}"].value
                readings[:, k] = (1.0 + gain) * np.interp(times, grid[:-1], sensed[:, k]) + bias
        return readings

    def _residual(self, weights: np.ndarray) -> Callable:
        def residual(found: Any, predicted: Any, measured: Any, *_: Any, **__: Any) -> tuple:
            readings = self._read(found, predicted.data)
            errors = np.clip(weights * (readings - measured.data), -self.case.cap, self.case.cap)
            series = mujoco_sysid.TimeSeries(measured.times, readings, measured.signal_mapping)
            return np.nan_to_num(errors).ravel(), series, measured

        return residual

    def _parameters(self) -> Any:
        """All identifiable parameters, at the values of the model."""
        Parameter, params = mujoco_sysid.Parameter, mujoco_sysid.ParameterDict()  # noqa: N806
        params.add(Parameter("delay", 0.0, 0.0, LATEST))
        for joint in self.made.joints:
            dof = self.model.joint(joint.name).dofadr[0]
            inertia, limit = float(self.model.dof_M0[dof]), joint.limit
            limit = limit if np.isfinite(limit) else float(np.max(self.made.robot.effort))
            for key, value, high in (
                ("armature", joint.armature, FACTOR * joint.armature + inertia),
                ("damping", self._damping(joint.name), FACTOR * (joint.damping + joint.kd + 0.01)),
                ("frictionloss", joint.friction, joint.friction + 0.5 * limit),
            ):
                params.add(Parameter(f"{key}_{joint.name}", value, 0.0, high,
                                     modifier=_of_joint(joint.name, key)))  # fmt: skip
        for index in range(self.model.nu):
            name = self.model.actuator(index).name
            gain, slope = self.model.actuator_gainprm[index, 0], self.model.actuator_biasprm[index]
            gains = np.array([gain, -slope[2]])
            params.add(Parameter(f"drive_{name}", [*gains, slope[0]],
                                 [*gains / FACTOR, slope[0] - ZERO * gain],
                                 [*gains * FACTOR + 1e-9, slope[0] + ZERO * gain],
                                 modifier=_of_drive(name, bool(slope[1]))))  # fmt: skip
        for body in self._moved():
            params.add(mujoco_sysid.body_inertia_param(
                self.spec, self.model, body, scale_rot_inertia=True,
                mass_bound_mult=np.array([1.0 / FACTOR, FACTOR]),
                ipos_bound_off=np.array([-ZERO, ZERO]),
            ))  # fmt: skip
        for channel in self.channels:
            if channel.signal == "q":
                limit = np.full(2, RANGE)
                params.add(Parameter(f"encoder_{channel.name}", [0.0, 0.0], -limit, limit))
        return params

    def _damping(self, joint: str) -> float:
        return float(self.model.dof_damping[self.model.joint(joint).dofadr[0]])

    def _moved(self) -> list[str]:
        """Names of the bodies with mass that a joint moves."""
        weld, mass = self.model.body_weldid, self.model.body_mass
        return [self.model.body(i).name for i in range(1, self.model.nbody)
                if weld[i] and mass[i] > 0.0]  # fmt: skip


def _of_joint(name: str, key: str) -> Callable:
    def change(spec: Any, parameter: Any) -> None:
        value, joint = float(parameter.value[0]), spec.joint(name)
        if key == "damping":
            joint.damping[0] = value
        else:
            setattr(joint, key, value)

    return change


def _of_drive(name: str, reads: bool) -> Callable:
    def change(spec: Any, parameter: Any) -> None:
        stiffness, damping, zero = map(float, parameter.value)
        drive = spec.actuator(name)
        drive.gainprm[0] = stiffness
        drive.biasprm[:3] = zero, -stiffness if reads else 0.0, -damping

    return change
