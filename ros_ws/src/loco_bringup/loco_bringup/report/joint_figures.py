# SPDX-License-Identifier: Apache-2.0
"""Figures of the report of a robot without legs; missing data raises an error."""

from __future__ import annotations

import numpy as np

from loco_control.exceptions import BagError
from loco_learning.drawing.chart import GREY, PALETTE, Axis, Chart, Frame, Layer, dots, line, short
from loco_learning.metrics import quantities, signals
from loco_learning.reflex.joint_sensors import passive_joints
from loco_learning.runs.log import Log
from loco_learning.study.trial import driven
from loco_sim.robot.frames import feet_in_base

from ..page import style
from ..page.plot import Line, Panel, Plot
from . import figures

MAX_JOINTS = 12  # largest number of joints in one plot


CHAPTERS, chapter = style.chapters()
OF_GAITS = {"Passive joints", "Prediction error", "Limit cycle", "Path", "Base motion", "Feet"}


# ---- parts of a log


def learned(log: Log) -> Log:
    """The log; raises an error unless a readout drove for two strides."""
    if not log.experiment.learner.enabled:
        raise BagError("open loop: this run has no network")
    if len(driven(log)) < 2 * quantities.period(log):
        raise BagError("the run ended before the readout had driven for two strides")
    return log


# ---- the figures


@chapter("Driven joints")
def driven_joints(log: Log) -> Plot:
    """Target, command and measured angle of each driven joint.

    What the joints are meant to do (target), what the drives are told (command) and what the joints
    do. In open loop the command is the target.
    """
    plant = log.experiment.plant
    if not len(plant.driven):
        raise BagError("the robot has no driven joint")
    panels = [
        Panel(
            f"{short(plant.joints[joint])} [rad]",
            figures.tracked(log.target[:, i], log.command[:, i], log.q[:, joint]),
        )
        for i, joint in enumerate(plant.driven[:MAX_JOINTS])
    ]
    return Plot(log.t, panels, style.spans(log), view=figures.close_look(log))


@chapter("Passive joints")
def passive(log: Log) -> Plot:
    """Angle of each passive joint.

    Angles as their sensors say, with noise and quantisation: no drive moves these joints, only
    springs and the ground.
    """
    plant = log.experiment.plant
    joints = passive_joints(plant)[:MAX_JOINTS]
    if not len(joints):
        raise BagError("every joint of this robot has a drive")
    panels = [
        Panel(
            f"{short(plant.joints[joint])} [rad]",
            [Line("measured", log.q[:, joint], style.MEASURED, 1.0)],
        )
        for joint in joints
    ]
    return Plot(log.t, panels, style.spans(log), view=figures.close_look(log))


@chapter("Prediction error")
def prediction_error(log: Log) -> Plot:
    """Smoothed NRMSE and lag through time.

    NRMSE of the predicted positions (thesis eq. 3.36) averaged over one stride, and how far the
    prediction is behind the oscillators, which go on in silence. Nothing ties the closed loop to
    their clock: a slow lag is a small difference in rhythm. Dashed: bounds of the criterion.
    """
    bounds, log = log.experiment.criterion, learned(log)
    valid = ~np.isnan(log.prediction[:, 0])
    if not valid.any():
        raise BagError("the bag has no joint_prediction")
    first, driven_part = int(np.argmax(valid)), driven(log)
    predicted = log.cut(slice(first, None))
    error, lag = np.full(len(log), np.nan), np.full(len(log), np.nan)
    error[first:] = signals.smoothed_nrmse(
        *quantities.target_and_prediction(predicted), quantities.period(log)
    )
    start = int(np.searchsorted(log.t, driven_part.t[0]))
    lag[start : start + len(driven_part)] = quantities.lag(driven_part)
    panels = [
        figures.error_panel(error, bounds.nrmse),
        Panel("lag [stride]", [Line("lag", lag, style.COMMAND)]),
    ]
    return Plot(log.t, panels, style.spans(log))


@chapter("Limit cycle")
def limit_cycle(log: Log) -> Chart:
    """Commands and passive joints in a common PCA plane, by phase.

    Commands and passive joints as one point per tick, in the plane of the two principal components
    of the whole run (thesis section 3.6.3.3), in the last strides of each phase. A gait is a closed
    loop; a thin one repeats well.
    """
    stride, phase_ticks = quantities.period(log), log.phases().items()
    phases = {k: v for k, v in phase_ticks if v.stop - v.start > stride and k != "stand"}
    if not phases:
        raise BagError("the run ended before the robot had made a stride")
    points = np.concatenate(
        (log.command, log.command_dq, log.q[:, passive_joints(log.experiment.plant)]), axis=1
    )
    plane = signals.limit_cycle(points, points)[1]
    frames = []
    for name, ticks in phases.items():
        first = max(ticks.start, ticks.stop - figures.STRIDES * stride)
        drives = name in ("closing", "test")
        label, color = (
            ("readout drives", style.COMMAND) if drives else ("oscillators drive", style.OTHER)
        )
        layers = [line(label, *plane[first : ticks.stop].T, color, size=0.9)]
        frames.append(figures.component_frame(layers, name))
    return Chart(figures.of_one_range(frames))


@chapter("Path")
def path(log: Log) -> Chart:
    """Position of the base in the horizontal plane, one colour per phase.

    The base from above. Dots: every fifth stride.
    """
    log = figures.posed(log)
    layers, step = list[Layer](), 5 * quantities.period(log)
    for i, (name, ticks) in enumerate(log.phases().items()):
        xy = log.position[slice(ticks.start, ticks.stop + 1), :2]
        layers.append(line(name, *xy.T, PALETTE[i], size=1.6))
    marks = log.position[::step, :2]
    labels = [f"stride {5 * k}" for k in range(len(marks))]
    layers.append(dots("every fifth stride", *marks.T, GREY, size=2.5, texts=labels))
    yaw = signals.roll_pitch_yaw(log.orientation)[-1, 2]
    x, y = log.position[-1, :2]
    reach = 0.05 * max(float(np.ptp(log.position[:, :2], axis=0).max()), 0.1)
    heading = [x, x + reach * np.cos(yaw)], [y, y + reach * np.sin(yaw)]
    layers.append(line("heading at the end", *heading, style.MEASURED, size=2.0))
    return Chart([Frame(Axis("x [m]"), Axis("y [m]"), layers, equal=True)])


chapter("Base motion", "Ground truth through the run, and its mean over a stride.")(
    figures.motion_of_base
)


@chapter("Feet")
def feet(log: Log) -> Chart:
    """Foot paths in the base frame and foot heights in the world.

    Paths of each foot in the frame of the base in the last strides, seen from the left. Heights of
    each foot over the lowest point that any reached, by ground truth and measured joints.
    """
    names = log.experiment.plant.feet
    if not names:
        raise BagError("the robot has no feet")
    log = figures.posed(log)
    log = log.cut(figures.whole_strides(log))
    positions = feet_in_base(log.experiment.plant, log.q)  # (T, f, 3)
    height = np.einsum("ti,tfi->tf", _down(log.orientation), positions) + log.position[:, 2:]
    lowest, rows = float(height.min()), slice(-2 * quantities.period(log), None)
    paths, heights = [], []
    for i, name in enumerate(names):
        label, color = name.replace("_foot", ""), PALETTE[i % len(PALETTE)]
        paths.append(line(label, *positions[:, i, ::2].T, color, size=1.0))
        heights.append(line(label, log.t[rows], 1e3 * (height[rows, i] - lowest), color))
    return Chart([
        Frame(Axis("x [m]"), Axis("z [m]"), paths, "paths", equal=True),
        Frame(Axis("time [s]"), Axis("height [mm]"), heights, "heights"),
    ])  # fmt: skip


def _down(quaternion: np.ndarray) -> np.ndarray:
    """Last row of the rotation base to world, (T, 3), which gives the height of a point."""
    x, y, z, w = quaternion.T
    return np.stack(
        [2.0 * (x * z - y * w), 2.0 * (y * z + x * w), 1.0 - 2.0 * (x**2 + y**2)], axis=1
    )


@chapter("Torque and power")
def torque_and_power(log: Log) -> Plot:
    """Torque of each drive and power through time.

    Torque of the drives, and their mechanical power averaged over two periods of the target;
    positive power takes braking as lost.
    """
    plant, window = log.experiment.plant, 2 * quantities.period(log)
    torques = [
        Line(short(plant.joints[joint]), log.tau[:, joint], PALETTE[i], 1.0)
        for i, joint in enumerate(plant.driven[: len(PALETTE)])
    ]
    return Plot(
        log.t,
        [Panel("torque [N·m]", torques), power(log, window)],
        style.spans(log),
        view=figures.close_look(log),
    )


def power(log: Log, window: int) -> Panel:
    """Mechanical power of the drives, averaged over a window [ticks]."""
    driven = log.experiment.plant.driven
    each = log.dq[:, driven] * log.tau[:, driven]
    positive = signals.moving_mean(np.maximum(each, 0.0).sum(axis=1), window)
    lines = [
        Line("positive work only", positive, style.OTHER),
        Line("signed", signals.moving_mean(each.sum(axis=1), window), style.MEASURED, 1.0),
    ]
    return Panel("power [W]", lines)
