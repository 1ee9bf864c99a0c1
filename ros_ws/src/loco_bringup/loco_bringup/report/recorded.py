# SPDX-License-Identifier: Apache-2.0
"""Report and comparison of recordings of other programs: joints, without a model of the robot."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from markupsafe import Markup

from loco_control.exceptions import BagError, ParameterError
from loco_learning.drawing.chart import PALETTE, short
from loco_learning.gap.importing.observe import stamps

from ..bag.foreign.opening import suffix_of
from ..logs.recording import COMMAND, Recording, at, read
from ..page import html, style
from ..page.plot import Line, Panel, Plot
from . import parts

MAX_JOINTS = 12  # largest number of joints in one plot
PAUSE = 5.0  # silence that is no line in a plot [median period]
LABELS = {"q": "position [rad or m]", "dq": "speed [rad/s or m/s]", "tau": "torque [N·m or N]"}
HEAD = ["Lowest position", "Highest position", "Tracking error, rms", "Largest tracking error",
        "Largest speed", "Torque, rms", "Largest torque"]  # fmt: skip

CHAPTERS, chapter = style.chapters()


def page(path: Path, mapping: Path | None = None) -> str:
    """HTML text of the report of one recording.

    Args:
        path: Bag or table of any recorder.
        mapping: Mapping of its columns or topics; None for the one beside it, or a draft.

    Raises:
        LocoError: The recording cannot be read.
    """
    recording = read(path, mapping)
    sections = [
        *parts.drawn(CHAPTERS, recording),
        html.part("Numbers", lambda: html.table(["Joint", *HEAD], numbers(recording), range(1, 8))),
        html.part("Clocks", lambda: clocks(recording)),
    ]
    if bag := recording.bag:
        sections.append(html.part("Messages", lambda: parts.message_table(bag)))
    last = [track.t[-1] for track in recording.tracks.values()]
    header = [
        html.paragraph(f"{max(last) - recording.start:.2f} s, joints: {len(recording.joints)}"),
        html.bullets(recording.notes),
    ]
    return html.document(recording.name, html.join(header), sections)


def axis(recording: Recording) -> np.ndarray:
    """Stamps of the positions of all joints [s], ascending."""
    return np.unique(np.concatenate([recording.tracks["q", joint].t for joint in recording.joints]))


def lines(recording: Recording, role: str, joint: str, t: np.ndarray) -> list[Line]:
    """Command and measurement of a joint at some stamps [s]; unknown in pauses."""
    styles = ((COMMAND[role], "command", style.COMMAND), (role, "measured", style.MEASURED))
    series = []
    for kind, name, color in styles:
        if track := recording.tracks.get((kind, joint)):
            values = at(track, t)
            if kind == role and len(track.t) > 2:
                step = np.diff(track.t)
                row = np.searchsorted(track.t, t, side="right") - 1
                in_pause = np.append(step > PAUSE * np.median(step), False)[row.clip(0)]
                values = np.where(in_pause & (t > track.t[row.clip(0)]), np.nan, values)
            series.append(Line(name, values, color, 1.2 if kind == role else 1.6))
    return series


def _plot(recording: Recording, role: str) -> Plot:
    t = axis(recording)
    panels = [
        Panel(f"{short(joint)} {LABELS[role][LABELS[role].index('[') :]}", series)
        for joint in recording.joints[:MAX_JOINTS]
        if (series := lines(recording, role, joint, t))
    ]
    if not panels:
        raise BagError(f"the recording has no {LABELS[role].partition(' [')[0]}")
    return Plot(t - recording.start, panels)


@chapter("Positions")
def positions(recording: Recording) -> Plot:
    """Command and measured position of each joint.

    A command is held until the next one. Time begins with the first measured position.
    """
    return _plot(recording, "q")


@chapter("Tracking error")
def tracking(recording: Recording) -> Plot:
    """Measured minus commanded position of each joint.

    At the stamps of the measurements; no delay between both is removed.
    """
    with_both = [j for j in recording.joints if ("command_position", j) in recording.tracks][
        : len(PALETTE)
    ]
    if not with_both:
        raise BagError("the recording has no commanded position of a measured joint")
    t = axis(recording)
    series = [
        Line(
            short(j),
            at(recording.tracks["q", j], t) - at(recording.tracks["command_position", j], t),
            c,
        )
        for j, c in zip(with_both, PALETTE, strict=False)
    ]
    return Plot(t - recording.start, [Panel("error [rad or m]", series)])


@chapter("Speeds")
def speeds(recording: Recording) -> Plot:
    """Command and measured speed of each joint."""
    return _plot(recording, "dq")


@chapter("Torques")
def torques(recording: Recording) -> Plot:
    """Command and measured torque of each joint."""
    return _plot(recording, "tau")


def values(recording: Recording, joint: str) -> list[float]:
    """Numbers of a joint in the order of `HEAD`; NaN where a signal is missing."""
    q, error = recording.tracks["q", joint].x, recording.error(joint)
    error = error[np.isfinite(error)]
    tracks = [recording.tracks[role, joint].x if (role, joint) in recording.tracks else np.zeros(0)
              for role in ("dq", "tau")]  # fmt: skip
    return [float(q.min()), float(q.max()), _rms(error), _largest(error), _largest(tracks[0]),
            _rms(tracks[1]), _largest(tracks[1])]  # fmt: skip


def _rms(x: np.ndarray) -> float:
    return float(np.sqrt(np.mean(x**2))) if len(x) else np.nan


def _largest(x: np.ndarray) -> float:
    return float(np.max(np.abs(x))) if len(x) else np.nan


def numbers(recording: Recording) -> list[list[str]]:
    """Rows of the table of `values`, one for each joint."""
    return [[joint, *map(html.number, values(recording, joint))] for joint in recording.joints]


def clocks(recording: Recording) -> Markup:
    """Table of rate, jitter, missing samples and longest silence, of the worst joint."""
    rows = [
        [role, *(html.number(one[key]) for key in ("rate", "jitter_ms", "missing", "silence"))]
        for role, one in stamps([*recording.tracks.values()]).items()
    ]
    head = ["Signal", "Rate [Hz]", "Jitter [ms]", "Missing samples", "Longest silence [s]"]
    return html.table(head, rows, range(1, 5))


# ---- comparison


def comparison(paths: list[Path], mapping: Path | None = None) -> tuple[str, list[str]]:
    """HTML text of the comparison of some recordings, and its largest differences as sentences.

    Args:
        paths: Recordings of any recorder or runs of loco; the first is the reference.
        mapping: Mapping of their columns; None for those beside them, or drafts.

    Raises:
        ParameterError: There are fewer than two, more than colours, or they share no joint.
        LocoError: A recording cannot be read.
    """
    if not 2 <= len(paths) <= len(PALETTE):
        raise ParameterError(f"name 2 to {len(PALETTE)} recordings to compare, got {len(paths)}")
    named = {path: read(path, mapping) for path in paths if suffix_of(path)}
    joints = next((one.joints for one in named.values()), ())
    every = [named.get(path) or read(path, mapping, joints) for path in paths]
    names = [one.name for one in every]
    if len(set(names)) < len(names):
        raise ParameterError(f"recordings of one name cannot be told apart: {', '.join(names)}")
    joints = [j for j in every[0].joints if all(j in one.joints for one in every)]
    if not joints:
        listed = "; ".join(f"{one.name} has {', '.join(one.joints)}" for one in every)
        raise ParameterError(f"the recordings have no joint in common: {listed}")
    rows, sentences = [], []
    for joint in joints:
        columns = list(zip(*(values(one, joint) for one in every), strict=True))
        rows += [
            [joint, what, *map(html.number, row)]
            for what, row in zip(HEAD, columns, strict=True)
            if not np.isnan(row).all()
        ]
        errors = " → ".join(map(html.number, columns[2]))
        sentences.append(f"{joint}: tracking error {errors} rad or m (rms)")
    notes = [f"{one.name}: {note}" for one in every for note in one.notes]
    title = f"Comparison of {' and '.join(names)}"
    header = html.join([html.paragraph(_TEXT), html.bullets([*sentences, *notes])])
    sections = [
        html.part("Positions", lambda: html.figure(_overlay(every, joints), "Positions", _OVERLAY)),
        html.part(
            "Numbers",
            lambda: html.table(["Joint", "Number", *names], rows, range(2, 2 + len(names))),
        ),
    ]
    return html.document(title, header, sections), sentences


def _overlay(every: list[Recording], joints: list[str]) -> Plot:
    t = max((axis(one) - one.start for one in every), key=lambda t: t[-1])
    panels = [
        Panel(
            f"{short(joint)} [rad or m]",
            [
                Line(one.name, at(one.tracks["q", joint], t + one.start), color)
                for one, color in zip(every, PALETTE, strict=False)
            ],
        )
        for joint in joints[:MAX_JOINTS]
    ]
    return Plot(t, panels)


_TEXT = (
    "Numbers of whole recordings side by side. Whether a difference exceeds the noise is judged "
    "only between runs of loco."
)
_OVERLAY = "Measured positions, each from the first reading of its recording on."
