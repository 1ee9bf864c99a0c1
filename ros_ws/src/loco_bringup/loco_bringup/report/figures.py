# SPDX-License-Identifier: Apache-2.0
"""Figures of a report; a figure whose data is missing raises an error with the reason.

A new figure is a function with the decorator `chapter`; the order in this file is
the order on the page. The figures of `motion` follow.
"""

from __future__ import annotations

import dataclasses

import numpy as np

from loco_control.exceptions import BagError
from loco_control.stance.controller import ESTIMATORS
from loco_learning.drawing.chart import GREY, Axis, Chart, Frame, Layer, bars, limits, line
from loco_learning.metrics import quantities, signals
from loco_learning.params import OPEN
from loco_learning.runs.log import Log

from ..page import style
from ..page.plot import Line, Panel, Plot
from ..record.readout_check import ReadoutCheck

WINDOW = 1.5  # length of the initial view of a plot [s]
STRIDES = 6  # number of strides in a foot cycle or an animation
SHOWN_TICKS = 200  # initially displayed ticks of the readout check
MAX_PAUSE = 0.2  # largest pause of learning that the timeline omits [s]
# Colours of the bars of phases, stronger than the tints behind signals.
PHASE_COLOURS = {"stand": "#c9c9c9", "train": "#8cb8dc", "closing": "#f0cf86", "test": "#8fcfae"}
PHASE_COLOURS[OPEN] = PHASE_COLOURS["train"]


CHAPTERS, chapter = style.chapters()


def tail(log: Log, length: float) -> slice:
    """The last `length` seconds of a log."""
    return slice(max(0, len(log) - round(length / log.dt)), len(log))


def whole_strides(log: Log) -> slice:
    """Ticks of the last complete strides of a log."""
    return tail(log, STRIDES * quantities.period(log) * log.dt)


def moving(log: Log) -> Log:
    """The log after the initial standing phase."""
    stand = log.phase_of("stand")
    if len(log) - stand.stop < quantities.period(log):
        raise BagError("the run ended before the robot had made a stride")
    return log.cut(slice(stand.stop, len(log)))


def motion_of_base(log: Log) -> Plot:
    """Height, roll, pitch, yaw and forward speed of the base; with a gait also the target speed.

    Args:
        log: A run with ground truth.

    Raises:
        BagError: The run has no ground truth.
    """
    log = posed(log)
    window = quantities.period(log)
    angles = signals.roll_pitch_yaw(log.orientation)
    rows = (
        ("height [m]", log.position[:, 2]),
        ("roll [rad]", angles[:, 0]),
        ("pitch [rad]", angles[:, 1]),
        ("yaw [rad]", angles[:, 2]),
        ("forward speed [m/s]", quantities.heading_speed(log)),
    )
    panels = []
    for label, y in rows:
        lines = [
            Line("as it is", y, "#999999", 0.7),
            Line("mean of a stride", signals.moving_mean(y, window), style.MEASURED),
        ]
        if label.startswith("forward") and quantities.walks(log):
            lines.insert(0, Line("target", log.target_speed, style.TARGET, 3.0))
        panels.append(Panel(label, lines))
    return Plot(log.t, panels, style.spans(log))


def posed(log: Log) -> Log:
    """The log with ground truth at every tick; gaps repeat the previous tick.

    Raises:
        BagError: The run has no ground truth.
    """
    valid = ~np.isnan(log.position[:, 0])
    if not valid.any():
        raise BagError("the bag has no ground_truth/odom")
    rows = np.maximum.accumulate(np.where(valid, np.arange(len(log)), np.argmax(valid)))
    names = ("position", "orientation", "velocity", "spin")
    return log.changed(**{name: log.columns[name][rows] for name in names})


def learned(log: Log) -> Log:
    """The log of a run with a network, after the initial standing phase."""
    if not log.experiment.learner.enabled:
        raise BagError("open loop: this run has no network")
    return moving(log)


# ---- the run


@chapter("Timeline")
def timeline(log: Log) -> Chart:
    """Bars over time: phases, driver, learning, estimator, effects, fall.

    Which signal drives hips and knees, how often the readout learns, who decides which legs stand,
    and when effects act on the plant.
    """
    effects = [e for e in log.experiment.effects if e.get("start", 0.0) < log.t[-1] + log.dt]
    lanes = ["phase", "HFE, KFE from", "readout learns", "stance from"]
    lanes += [e["name"].replace("_", " ") for e in effects]
    layers = [
        bars(name, [(start, stop - start)], 0, PHASE_COLOURS[name])
        for _, name, start, stop in style.spans(log)
    ]
    for flags, name, color in zip(
        drivers(log),
        ("target drives", "readout drives"),
        (style.TARGET, style.COMMAND),
        strict=True,
    ):
        layers.append(bars(name, style.flag_spans(log.t, flags, log.dt), 1, color))
    learning = style.flag_spans(log.t, log.learning.astype(bool), log.dt)
    layers.append(bars("learns", _merge(learning), 2, style.OTHER))
    for index, name in enumerate(ESTIMATORS):
        flags = style.flag_spans(log.t, log.estimator == index, log.dt)
        layers.append(bars(f"stance from {name.upper()}", flags, 3, (GREY, "#e69f00")[index]))
    for lane, effect in enumerate(effects, 4):
        start = max(float(effect.get("start", 0.0)), float(log.t[0]))
        stop = min(float(effect.get("stop", np.inf)), float(log.t[-1]) + log.dt)
        layers.append(bars("effect", [(start, stop - start)], lane, "#cc79a7"))
    if log.fall:
        end = float(log.t[-1])
        layers.append(line("fall", [end, end], [-0.5, len(lanes) - 0.5], style.BOUND, size=3.0))
    # The first lane is at the top.
    layers = [transpose(layer, len(lanes)) for layer in layers]
    span = (float(log.t[0]), float(log.t[-1]) + log.dt)
    axes = Axis("time [s]", limits=span), Axis("signal", names=lanes[::-1])
    return Chart([Frame(*axes, layers, height=60 + 30 * len(lanes))])


def transpose(layer: Layer, lanes: int) -> Layer:
    """A layer with inverted lanes, so that lane 0 is at the top of an axis of names.

    Args:
        layer: The layer.
        lanes: Number of lanes.
    """
    if layer.top is None:
        return dataclasses.replace(layer, y=lanes - 1.0 - layer.y)
    return dataclasses.replace(layer, y=lanes - 1.0 - layer.top, top=lanes - 1.0 - layer.y)


def _merge(spans: list[tuple[float, float]], gap: float = MAX_PAUSE) -> list[tuple[float, float]]:
    """Intervals (start, length) [s]; intervals less than `gap` [s] apart are merged."""
    merged: list[tuple[float, float]] = []
    for start, length in spans:
        if merged and start - sum(merged[-1]) < gap:
            first = merged.pop()[0]
            length, start = start + length - first, first
        merged.append((start, length))
    return merged


def drivers(log: Log) -> tuple[np.ndarray, np.ndarray]:
    """Masks of the ticks at which the target and the readout drive HFE and KFE, (T,) each."""
    command = quantities.outputs_commanded(log)
    by_target = np.all(command == quantities.outputs_wanted(log), axis=1)
    return by_target, np.all(command == log.prediction, axis=1) & ~by_target


@chapter("Joint tracking")
def joint_tracking(log: Log) -> Plot:
    """Target, command and measured position of every joint of a walking robot.

    What the joints should do (target), what they are told (command) and what they do. While the
    target drives, the command is the target.
    """
    panels = [
        Panel(
            f"{name.removesuffix('_joint').replace('_', ' ').upper()} [rad]",
            tracked(log.target[:, i], log.command[:, i], log.q[:, i]),
        )
        for i, name in enumerate(log.experiment.plant.joints)
    ]
    return Plot(log.t, panels, style.spans(log), view=close_look(log))


def close_look(log: Log) -> tuple[float, float]:
    """Start and end [s] of the last strides of a log."""
    return max(log.t[0], log.t[-1] - STRIDES * quantities.period(log) * log.dt), log.t[-1]


def tracked(target: np.ndarray, command: np.ndarray, measured: np.ndarray) -> list[Line]:
    """Lines of target, command and measurement of a joint, (T,) each, in the common colours."""
    return [
        Line("target", target, style.TARGET, 3.0),
        Line("command", command, style.COMMAND),
        Line("measured", measured, style.MEASURED, 1.0),
    ]


# ---- learning


@chapter("Prediction error")
def prediction_error(log: Log) -> Plot:
    """Smoothed NRMSE, lag and weight norm through time.

    NRMSE of the eight predicted positions (thesis eq. 3.36) averaged over one gait period, how far
    the prediction is behind its target, and the norm of the readout. Dashed: bound of the failure
    criterion.
    """
    criterion, log = log.experiment.criterion, learned(log)
    target, prediction = quantities.target_and_prediction(log)
    error = signals.smoothed_nrmse(target, prediction, quantities.period(log))
    panels = [
        error_panel(error, criterion.nrmse),
        Panel("lag [stride]", [Line("lag", quantities.lag(log), style.COMMAND)]),
        Panel("readout norm [-]", [Line("readout norm", log.weight_norm, style.OTHER)]),
    ]
    return Plot(log.t, panels, style.spans(log))


def error_panel(error: np.ndarray, bound: float) -> Panel:
    """Panel with the smoothed NRMSE, (T,), and the bound of the failure criterion."""
    lines = [
        Line("error", error, style.COMMAND),
        Line("bound", np.full(len(error), bound), style.MEASURED, dashed=True),
    ]
    return Panel("smoothed NRMSE [-]", lines, logarithmic=True)


@chapter("Limit cycle")
def limit_cycle(log: Log) -> Chart:
    """Target, command and measured joints in the target's PCA plane, by phase.

    Positions and velocities of the eight hips and knees in the plane of the two principal
    components of their targets (thesis section 3.6.3.3, fig. 8.4), in the last strides of each
    phase. Each channel is measured in standard deviations of its target.
    """
    log = moving(log)
    target, outputs = quantities.outputs_wanted(log), log.experiment.outputs
    tracks = (
        (target, "target", style.TARGET, style.BROAD),
        (quantities.outputs_commanded(log), "command", style.COMMAND, 1.2),
        (
            np.concatenate((log.q[:, outputs], log.dq[:, outputs]), axis=1),
            "measured", style.MEASURED, 0.8,
        ),
    )  # fmt: skip
    planes = [(signals.limit_cycle(target, x)[1], *style) for x, *style in tracks]
    frames = []
    for name, ticks in log.phases().items():
        first = max(ticks.start, ticks.stop - STRIDES * quantities.period(log))
        layers = [line(label, *plane[first : ticks.stop].T, color, size=size)
                  for plane, label, color, size in planes]  # fmt: skip
        frames.append(component_frame(layers, name))
    return Chart(of_one_range(frames))


def component_frame(layers: list[Layer], title: str) -> Frame:
    """Frame of two principal components.

    Args:
        layers: Layers of the frame.
        title: Name of the frame.
    """
    axes = (Axis(f"{rank} component [-]") for rank in ("1st", "2nd"))
    return Frame(*axes, layers, title, equal=True, height=300)


def of_one_range(frames: list[Frame]) -> list[Frame]:
    """Frames with common axis ranges.

    Args:
        frames: The frames, at least one.
    """
    extents = [np.array([limits(f, horizontal) for f in frames]) for horizontal in (True, False)]
    across, up = ((float(e[:, 0].min()), float(e[:, 1].max())) for e in extents)
    return [
        dataclasses.replace(
            f, x=dataclasses.replace(f.x, limits=across), y=dataclasses.replace(f.y, limits=up)
        )
        for f in frames
    ]


def readout(check: ReadoutCheck, joint: int = 1, name: str = "LF KFE") -> Plot:
    """Command of one joint and the recomputed network, and their differences in the test phase."""
    error = np.max(np.abs(check.commanded - check.recomputed), axis=1)
    panels = [
        Panel(
            f"{name} [rad]",
            [
                Line("target", check.target[:, joint], style.TARGET, style.BROAD),
                Line("network run again", check.recomputed[:, joint], style.OTHER, 2.4),
                Line("command", check.commanded[:, joint], style.COMMAND),
            ],
        ),
        Panel(
            "distance of the command [rad, rad/s]",
            [
                Line(
                    "from the target", np.maximum(check.target_distance, _ZERO), style.TARGET, 2.0
                ),
                Line("from the network run again", np.maximum(error, _ZERO), style.OTHER),
            ],
            logarithmic=True,
        ),
    ]
    interval = check.t[-min(len(check.t), SHOWN_TICKS)], check.t[-1]
    return Plot(check.t, panels, view=(float(interval[0]), float(interval[1])))


_ZERO = 1e-16  # drawn in place of a difference of 0
