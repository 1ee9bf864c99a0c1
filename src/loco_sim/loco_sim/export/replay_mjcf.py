# SPDX-License-Identifier: Apache-2.0
"""Replay of recorded commands on an exported MJCF in MuJoCo alone, compared with the recording.

    python replay.py model.xml replay.npz

Requires mujoco and numpy, not loco. Contents of ``replay.npz``, for T samples:
    dt          time between samples [s]
    finer       physics steps per step of the file
    ctrl        commands of the actuators, (T, nu)
    ramps       1 if commands are interpolated between samples, 0 if they are held
    power       voltage / nominal voltage, and 1 for motors on or 0 for off, (T, 2)
    joints      names of the n measured joints
    q, dq       initial positions and velocities [rad, rad/s], (n,)
    measured    measured positions [rad], (T, n), NaN where missing

An environment that trains on the file must use `Drives` as in `play`, and the command delay.
"""

import json
import sys

import mujoco
import numpy as np


def numeric(model, name):
    """Numbers of `<custom>`, zeros if missing, (nu,)."""
    index = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_NUMERIC, name)
    if index < 0:
        return np.zeros(model.nu)
    start = model.numeric_adr[index]
    return model.numeric_data[start : start + model.nu]


class Drives:
    """Properties of drives that MuJoCo's actuators lack.

    A servo measures its joint with the resolution of its encoder but turns a rotor behind an
    elastic gear; its limit holds for driving plus braking torque; it can be switched off, and
    its supply voltage scales its torque.
    """

    def __init__(self, model):
        self.model = model
        self.step, self.effort = numeric(model, "resolution"), numeric(model, "effort")
        self.brake, encoder = numeric(model, "brake"), numeric(model, "encoder")
        self.plain = not (self.step.any() or self.effort.any() or encoder.any())
        joints, names = model.actuator_trnid[:, 0], range(model.nu)
        self.turned, self.dofs = model.jnt_qposadr[joints], model.jnt_dofadr[joints]
        self.read = [model.joint(model.actuator(i).name).qposadr[0] for i in names]
        self.tables = model.actuator_gainprm, model.actuator_biasprm, model.actuator_forcerange
        self.full, self.damping = [t.copy() for t in self.tables], model.dof_damping.copy()

    def power(self, supply, on):
        """Set voltage / nominal voltage, and 1 for motors on or 0 for off."""
        share = on * np.where(self.brake > 0.0, supply, 1.0)
        for table, full in zip(self.tables, self.full, strict=True):
            table[:] = full * share[:, None]
        self.model.dof_damping[self.dofs] = self.damping[self.dofs] - (1.0 - on) * self.brake

    def ctrl(self, data, wanted):
        """Values of ctrl in this physics step for the commands `wanted` of the drives, (nu,)."""
        if self.plain:
            return wanted
        gain, bias, limits = (table.T for table in self.tables)
        q, measured = data.qpos[self.turned], data.qpos[self.read]
        steps = np.fmax(self.step, 1e-9)
        measured = np.where(self.step > 0.0, steps * np.floor(measured / steps + 0.5), measured)
        ctrl = wanted + q - measured
        torque = gain[0] * ctrl + bias[0] + bias[1] * q
        braking = self.brake * data.qvel[self.dofs]
        total = np.clip(torque, limits[0], limits[1]) - braking
        over = (np.abs(total) > self.effort) & (self.effort > 0.0) & (gain[0] > 0.0)
        max_torque = np.clip(total, -self.effort, self.effort) + braking
        return np.where(over, ctrl + (max_torque - torque) / np.fmax(gain[0], 1e-9), ctrl)


def play(model, given):
    """Positions of the joints before each command [rad], (T, n)."""
    data, drives = mujoco.MjData(model), Drives(model)
    step = model.opt.timestep / float(given["finer"])
    steps = max(1, int(np.ceil(float(given["dt"]) / step - 0.01)))
    model.opt.timestep = float(given["dt"]) / steps
    for name, q, dq in zip(given["joints"], given["q"], given["dq"], strict=True):
        for joint in (name, f"{name}_rotor"):
            if mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_JOINT, joint) >= 0:
                data.qpos[model.joint(joint).qposadr[0]] = q
                data.qvel[model.joint(joint).dofadr[0]] = dq
    at = [model.joint(str(name)).qposadr[0] for name in given["joints"]]
    rows = np.arange(len(given["ctrl"]) * steps)
    share = (rows % steps / steps)[:, None] * float(given["ramps"])
    current, after = rows // steps, np.minimum(rows // steps + 1, len(given["ctrl"]) - 1)
    table = (1.0 - share) * given["ctrl"][current] + share * given["ctrl"][after]
    for column, delay in enumerate(numeric(model, "delay")):
        late = np.maximum(rows - round(delay / model.opt.timestep), 0)
        table[:, column] = table[late, column]
    names = [model.actuator(i).name for i in range(model.nu)]
    turns = dict(zip(names, numeric(model, "offset"), strict=True))
    offset = np.array([turns.get(str(name), 0.0) for name in given["joints"]])
    positions = np.empty((len(given["ctrl"]), len(at)))
    for row in rows:
        if row % steps == 0:
            positions[row // steps] = data.qpos[at] - offset
            drives.power(*given["power"][row // steps])
        data.ctrl[:] = drives.ctrl(data, table[row])
        mujoco.mj_step(model, data)
    return positions


def main():
    """Print the RMS error of each joint as JSON."""
    model = mujoco.MjModel.from_xml_path(sys.argv[1])
    recording = np.load(sys.argv[2])
    error = play(model, recording) - recording["measured"]
    rms = np.sqrt(np.nanmean(error**2, axis=0))
    print(json.dumps(dict(zip(map(str, recording["joints"]), rms.tolist(), strict=True))))


if __name__ == "__main__":
    main()
