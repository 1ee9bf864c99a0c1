# SPDX-License-Identifier: Apache-2.0
"""Play recorded commands to an exported MJCF in MuJoCo alone, and compare it with the recording.

    python replay.py model.xml replay.npz

Needs mujoco and numpy, nothing of loco. Of ``replay.npz``, over T samples:
    dt          time between samples [s]
    finer       physics steps in one of the file
    ctrl        commands of the actuators, (T, nu)
    ramps       1 where commands run straight between samples, 0 where they are held
    joints      names of the n joints that were measured
    q, dq       where they begin [rad, rad/s], (n,)
    measured    their measured positions [rad], (T, n), NaN where there is none
"""

import json
import sys

import mujoco
import numpy as np


def numeric(model, name):
    """Numbers of `<custom>`, zeros without them, (nu,)."""
    index = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_NUMERIC, name)
    if index < 0:
        return np.zeros(model.nu)
    start = model.numeric_adr[index]
    return model.numeric_data[start : start + model.nu]


def play(model, given):
    """Positions of the joints before each command [rad], (T, n)."""
    data = mujoco.MjData(model)
    step = model.opt.timestep / float(given["finer"])
    steps = max(1, int(np.ceil(float(given["dt"]) / step - 0.01)))
    model.opt.timestep = float(given["dt"]) / steps
    joints = [model.joint(str(name)) for name in given["joints"]]
    at = [joint.qposadr[0] for joint in joints]
    data.qpos[at] = given["q"]
    data.qvel[[joint.dofadr[0] for joint in joints]] = given["dq"]
    rows = np.arange(len(given["ctrl"]) * steps)
    share = (rows % steps / steps)[:, None] * float(given["ramps"])
    now, after = rows // steps, np.minimum(rows // steps + 1, len(given["ctrl"]) - 1)
    table = (1.0 - share) * given["ctrl"][now] + share * given["ctrl"][after]
    for column, delay in enumerate(numeric(model, "delay")):
        late = np.maximum(rows - round(delay / model.opt.timestep), 0)
        table[:, column] = table[late, column]
    offset = np.zeros(len(at))
    for turn, (joint, _) in zip(numeric(model, "offset"), model.actuator_trnid, strict=True):
        for column, one in enumerate(joints):
            offset[column] = turn if one.id == joint else offset[column]
    said = np.empty((len(given["ctrl"]), len(at)))
    for row in rows:
        if row % steps == 0:
            said[row // steps] = data.qpos[at] - offset
        data.ctrl[:] = table[row]
        mujoco.mj_step(model, data)
    return said


def main():
    """Print the rms of each joint as JSON."""
    model = mujoco.MjModel.from_xml_path(sys.argv[1])
    given = np.load(sys.argv[2])
    error = play(model, given) - given["measured"]
    rms = np.sqrt(np.nanmean(error**2, axis=0))
    print(json.dumps(dict(zip(map(str, given["joints"]), rms.tolist(), strict=True))))


if __name__ == "__main__":
    main()
