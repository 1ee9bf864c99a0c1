# SPDX-License-Identifier: Apache-2.0
"""Figures of a joint robot's report: each draws one thing about a log, or says why it cannot."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from loco_control.exceptions import BagError
from loco_learning.metrics import quantities, signals
from loco_learning.reflex.joint_sensors import passive_joints
from loco_learning.runs.log import Log
from loco_learning.study.trial import driven
from loco_sim.robot.frames import feet_in_base

from ..page.style import (
    BOUND,
    COMMAND,
    MEASURED,
    OTHER,
    TARGET,
    canvas,
    chapters,
    envelope,
    every,
    legend,
    shade,
    tint,
)
from .figures import motion_of_base, posed, thin

WINDOW = 3.0  # strides of a close look
STRIDES = 6  # of a foot path or a limit cycle
PALETTE = ("#0072b2", "#d55e00", "#009e73", "#cc79a7", "#e69f00", "#56b4e9", "#222222", "#999999")


CHAPTERS, chapter = chapters()


# ---- what is drawn of a log


def tail(log: Log, strides: float) -> slice:
    """The last strides of a log."""
    return slice(max(0, len(log) - round(strides * quantities.period(log))), len(log))


def windows(log: Log) -> list[tuple[str, slice]]:
    """Titles and ticks of close looks: where the readout takes over, and the end."""
    found, width = [], round(WINDOW * quantities.period(log))
    for name in ("closing", "test"):
        ticks = log.phases().get(name)
        if ticks and ticks.start + width // 2 < len(log):
            begin = max(0, ticks.start - width // 3)
            found.append((f"{name} begins", slice(begin, min(len(log), begin + width))))
    return [*found[-2:], ("end of the run", tail(log, WINDOW))]


def learned(log: Log) -> Log:
    """The log, if a readout drove for two strides."""
    if not log.experiment.learner.enabled:
        raise BagError("open loop: this run has no network")
    if len(driven(log)) < 2 * quantities.period(log):
        raise BagError("the run ended before the readout had driven for two strides")
    return log


def short(joint: str) -> str:
    """Name of a joint without the word."""
    return joint.removesuffix("_joint").replace("_", " ")


# ---- the figures


@chapter(
    "Driven joints",
    "What the oscillators want (target), what the drives are told (command) and what the joints "
    "do. In open loop the command is the target.",
)
def driven_joints(log: Log) -> Figure:
    """Target, command and measured angle of each driven joint in a few windows."""
    plant, looks = log.experiment.plant, windows(log)
    if not len(plant.driven):
        raise BagError("the robot has no driven joint")
    rows = min(len(plant.driven), 8)
    figure, axes = canvas(rows, len(looks), 0.7 + 1.15 * rows, sharey="row", sharex="col")
    for column, (title, ticks) in enumerate(looks):
        t = log.t[ticks]
        for row, joint in enumerate(plant.driven[:rows]):
            ax = axes[row, column]
            ax.plot(t, log.target[ticks, row], label="target", **TARGET)
            ax.plot(t, log.command[ticks, row], label="command", **COMMAND)
            ax.plot(t, log.q[ticks, joint], label="measured", **MEASURED)
            _close_look(ax, log, ticks, column, f"{short(plant.joints[joint])}\n[rad]")
        axes[0, column].set_title(title)
        axes[-1, column].set_xlabel("time [s]")
    figure.align_ylabels(axes)
    legend(figure, axes[0, 0])
    return figure


@chapter(
    "Passive joints",
    "Angles as their sensors say, with noise and quantisation: no drive moves these joints, only "
    "springs and the ground.",
)
def passive(log: Log) -> Figure:
    """Angle of each passive joint in a few windows."""
    plant, looks = log.experiment.plant, windows(log)
    found = passive_joints(plant)[:8]
    if not len(found):
        raise BagError("every joint of this robot has a drive")
    figure, axes = canvas(
        len(found), len(looks), 0.6 + 1.0 * len(found), sharey="row", sharex="col"
    )
    for column, (title, ticks) in enumerate(looks):
        for row, joint in enumerate(found):
            ax = axes[row, column]
            ax.plot(log.t[ticks], log.q[ticks, joint], **MEASURED)
            _close_look(ax, log, ticks, column, f"{short(plant.joints[joint])}\n[rad]")
        axes[0, column].set_title(title)
        axes[-1, column].set_xlabel("time [s]")
    figure.align_ylabels(axes)
    return figure


def _close_look(ax, log: Log, ticks: slice, column: int, label: str) -> None:
    ax.margins(x=0)
    tint(ax, log, ticks)
    if column == 0:
        ax.set_ylabel(label)


@chapter(
    "Prediction error",
    "NRMSE of the predicted positions (thesis eq. 3.36) averaged over one stride, and how far the "
    "prediction is behind the oscillators, which go on in silence. Nothing ties the closed loop "
    "to their clock: a slow lag is a small difference in rhythm. Dashed: bounds of the criterion.",
)
def prediction_error(log: Log) -> Figure:
    """Smoothed NRMSE and lag through time."""
    bounds, log = log.experiment.criterion, learned(log)
    figure, axes = canvas(2, 1, 3.6, sharex=True)
    top, bottom = axes[:, 0]
    known = ~np.isnan(log.prediction[:, 0])
    if not known.any():
        raise BagError("the bag has no joint_prediction")
    shown = log.cut(slice(int(np.argmax(known)), None))
    target, prediction = quantities.target_and_prediction(shown)
    error = signals.smoothed_nrmse(target, prediction, quantities.period(log))
    times, low, high = envelope(shown.t, error, max(1, len(shown) // 450))
    top.fill_between(times, low, high, color=COMMAND["color"], alpha=0.35, linewidth=0)
    top.plot(times, high, **COMMAND)
    top.axhline(bounds.nrmse, **BOUND)
    top.set(yscale="log", ylabel="smoothed NRMSE [-]")
    alone = driven(log)
    bottom.plot(*thin(alone.t, quantities.lag(alone)), **COMMAND)
    bottom.axhline(0.0, color="#999999", linewidth=0.6)
    bottom.set(ylabel="lag [stride]", xlabel="time [s]")
    low, high = bottom.get_ylim()
    bottom.set_ylim(min(low, -0.1), max(high, 0.1))
    shade(axes, log)
    figure.align_ylabels(axes)
    return figure


@chapter(
    "Limit cycle",
    "Commands and passive joints as one point per tick, in the plane of the two principal "
    "components of the whole run (thesis section 3.6.3.3), in the last strides of each phase. "
    "A gait is a closed loop; a thin one repeats well.",
)
def limit_cycle(log: Log) -> Figure:
    """Commands and passive joints in a common PCA plane, by phase."""
    stride, whole = quantities.period(log), log.phases().items()
    found = {k: v for k, v in whole if v.stop - v.start > stride and k != "stand"}
    if not found:
        raise BagError("the run ended before the robot had made a stride")
    points = np.concatenate(
        (log.command, log.command_dq, log.q[:, passive_joints(log.experiment.plant)]), axis=1
    )
    plane = signals.limit_cycle(points, points)[1]
    figure, axes = canvas(1, max(2, len(found)), 2.5, sharex=True, sharey=True)
    for ax in axes[0, len(found) :]:
        ax.set_axis_off()
    for ax, (name, ticks) in zip(axes[0], found.items(), strict=False):
        first = max(ticks.start, ticks.stop - STRIDES * stride)
        ax.plot(*plane[first : ticks.stop].T, **(COMMAND if name in ("closing", "test") else OTHER))
        ax.set_title(name)
        ax.set(aspect="equal", xlabel="1st component [-]")
    axes[0, 0].set_ylabel("2nd component [-]")
    return figure


@chapter("Path", "The base from above. Grey dots: every fifth stride; the arrow is the heading.")
def path(log: Log) -> Figure:
    """Position of the base in the plane, one colour per phase."""
    log = posed(log)
    figure, axes = canvas(1, 1, 2.9)
    ax, step = axes[0, 0], 5 * quantities.period(log)
    for i, (name, ticks) in enumerate(log.phases().items()):
        xy = log.position[slice(ticks.start, ticks.stop + 1), :2][every(log.t[ticks])]
        ax.plot(*xy.T, color=PALETTE[i], linewidth=1.3, label=name)
    ax.plot(*log.position[::step, :2].T, linestyle="", marker=".", color="#888888", markersize=4)
    yaw = signals.roll_pitch_yaw(log.orientation)[-1, 2]
    x, y = log.position[-1, :2]
    ax.annotate("", (x + 0.06 * np.cos(yaw), y + 0.06 * np.sin(yaw)), (x, y),
                arrowprops={"arrowstyle": "->"})  # fmt: skip
    ax.set(aspect="equal", adjustable="datalim", xlabel="x [m]", ylabel="y [m]")
    legend(figure, ax)
    return figure


@chapter(
    "Base motion",
    "Ground truth through the run: range within each stride (band) and mean over a stride (line).",
)
def base_motion(log: Log) -> Figure:
    """Height, roll, pitch, yaw and forward speed."""
    return motion_of_base(log, 6.4)


@chapter(
    "Feet",
    "Left: path of each foot in the frame of the base in the last strides, seen from the left. "
    "Right: height of each foot over the lowest point that any reached, by ground truth and "
    "measured joints.",
)
def feet(log: Log) -> Figure:
    """Foot paths in the base frame and foot heights in the world."""
    names = log.experiment.plant.feet
    if not names:
        raise BagError("the robot has no feet")
    log = posed(log).cut(tail(posed(log), STRIDES))
    places = feet_in_base(log.experiment.plant, log.q)  # (T, f, 3)
    figure, axes = canvas(1, 2, 3.2, width_ratios=(1.25, 1))
    left, right = axes[0]
    height = np.einsum("ti,tfi->tf", _down(log.orientation), places) + log.position[:, 2:]
    lowest = float(height.min())
    rows = slice(-2 * quantities.period(log), None)
    for i, name in enumerate(names):
        look = {"color": PALETTE[i % len(PALETTE)], "linewidth": 1.0}
        left.plot(*places[:, i, ::2].T, label=name.replace("_foot", ""), **look)
        right.plot(log.t[rows], 1e3 * (height[rows, i] - lowest), **look)
    left.set(aspect="equal", adjustable="datalim", xlabel="x [m]", ylabel="z [m]")
    right.set(xlabel="time [s]", ylabel="height [mm]")
    right.margins(x=0)
    legend(figure, left)
    return figure


def _down(quaternion: np.ndarray) -> np.ndarray:
    """Last row of the rotation base to world, (T, 3): what makes the height of a point."""
    x, y, z, w = quaternion.T
    return np.stack(
        [2.0 * (x * z - y * w), 2.0 * (y * z + x * w), 1.0 - 2.0 * (x**2 + y**2)], axis=1
    )


@chapter(
    "Torque and power",
    "Torque of the drives in the last strides, and their mechanical power through the run, "
    "averaged over two strides; positive power takes braking as lost.",
)
def torque_and_power(log: Log) -> Figure:
    """Torque of each drive in a window, power through time."""
    plant = log.experiment.plant
    figure, axes = canvas(2, 1, 4.0)
    top, bottom = axes[:, 0]
    rows, window = tail(log, WINDOW), 2 * quantities.period(log)
    for i, joint in enumerate(plant.driven[: len(PALETTE)]):
        label = short(plant.joints[joint])
        top.plot(log.t[rows], log.tau[rows, joint], color=PALETTE[i], linewidth=0.9, label=label)
    top.set(ylabel="torque [N·m]", xlabel="time [s]")
    top.margins(x=0)
    each = log.dq[:, plant.driven] * log.tau[:, plant.driven]
    positive = signals.moving_mean(np.maximum(each, 0.0).sum(axis=1), window)
    bottom.plot(*thin(log.t, positive), label="positive work only", **OTHER)
    bottom.plot(
        *thin(log.t, signals.moving_mean(each.sum(axis=1), window)), label="signed", **MEASURED
    )
    bottom.set(ylabel="power [W]", xlabel="time [s]", ylim=(None, 1.3 * max(positive.max(), 1e-6)))
    bottom.legend(loc="upper right", ncols=2)
    shade(axes[1:], log)
    legend(figure, top, 8)
    figure.align_ylabels(axes)
    return figure
