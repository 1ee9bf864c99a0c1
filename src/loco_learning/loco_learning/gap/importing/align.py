# SPDX-License-Identifier: Apache-2.0
"""Alignment: signals with their own uneven time stamps on one even time axis, with notes.

No signal is shifted: a delay between command and motion may be due to the clock, or it may be the
effect that is sought, so it is measured and reported (`lags`), but not removed.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from loco_control.exceptions import ParameterError
from loco_sim.robot.robot import Robot

from ..recordings import lags
from ..recordings.clocks import cuts, series, slow, stale, steady, ticks
from ..recordings.clocks.params import CUTS
from ..recordings.record import COMMANDS, INPUTS, JOINT_SIGNALS, WIDTHS, Doubt, Record
from ..recordings.tracks import AXES, Track, correct, followed
from ..setup import suspect
from . import checks, observe

ROUND = 2e-3  # a rate this close to that of the robot, or to a multiple of 10, is set to it
FINE_STEP = 2e-4  # [s] simulations with longer steps get a note on their error
STEPS = (
    "recorded from a simulation in steps of {:g} ms, whose error counts as noise: smaller effects "
    "show with --set sim.physics_rate=8000"
)


def records(name: str, tracks: Sequence[Track], robot: Robot, **about: Any) -> list[Record]:
    """Align the signals of one file: one record per stretch without a step back of its clock.

    Args:
        name: Name of the record; several are numbered.
        tracks: Signals of the robot's joints, feet and axes.
        robot: Robot that was measured.
        about: Further arguments of `record`, e.g. rate, role, overrides, notes; and `mend`.

    Raises:
        ParameterError: The data contradict their description.
    """
    tracks = correct(tracks, about.pop("mend", ()))
    couplings: list[str] = []
    tracks = followed(tracks, robot, couplings)
    parts, notes = cuts.parts(name, tracks, checks.MIN_SAMPLES, checks.MIN_DURATION)
    about["notes"] = (*about.get("notes", ()), *couplings, *notes)
    names = [f"{name} part {i}" for i in range(1, len(parts) + 1)] if len(parts) > 1 else [name]
    return [record(n, part, robot, **about) for n, part in zip(names, parts, strict=True)]


def record(
    name: str,
    tracks: Sequence[Track],
    robot: Robot,
    rate: float = 0.0,
    notes: Sequence[str] = (),
    trust_units: bool = False,
    judge: bool = True,
    **attributes: Any,
) -> Record:
    """Align the signals of one experiment.

    A command holds from its time stamp on, unless its track is linear between samples or
    undersampled (`slow`); readings come to the even times as in `ticks.sample`.

    Args:
        name: Name of the record, for messages.
        tracks: Signals of the robot's joints, feet and axes.
        robot: Robot that was measured.
        rate: Samples per second; 0 takes the higher of the rates of angles and commands.
        notes: Sentences about the file from the importer.
        trust_units: Whether to skip the checks for wrong units.
        judge: Whether to reject signals that are probably in a wrong unit; if not, `setup.family`
            reports them.
        attributes: Attributes `role`, `overrides`, `simulated` and `joint_torque` of the record.

    Raises:
        ParameterError: The data contradict their description; see `checks`, `suspect`.
    """
    checks.present(name, tracks, robot)
    if not trust_units:
        suspect.times(name, tracks)
    messages = list(notes)
    if not trust_units:
        single = [track for track in tracks if not cuts.cut_rows([track])]
        series.single(name, [observe.unwrapped(track, robot, []) for track in single])
    stamped = stale.fresh(checks.measured(name, tracks, messages), messages)
    tracks = steady.steadied(stamped, messages)
    delays = [np.ptp(old.t - new.t) for old, new in zip(stamped, tracks, strict=True)
              if new.role == "q"]  # fmt: skip
    tracks = observe.without_placeholder(
        [_ordered(name, track, messages) for track in tracks], messages
    )
    wrapped = tracks
    tracks = [observe.unwrapped(track, robot, messages) for track in wrapped]
    tracks = [new if new is old else observe.beside_command(new, tracks, messages)
              for old, new in zip(wrapped, tracks, strict=True)]  # fmt: skip
    tracks = _one_sheet(tracks)
    checks.moving(name, tracks)
    start, end = _overlap(name, tracks)
    messages += _unused(tracks, start, end)
    own_rate = rate or _rate(tracks, robot)
    sparse = [] if rate else slow.undersampled(tracks, own_rate, robot)
    rate = slow.multiple(own_rate, robot) if sparse else own_rate
    axis = ticks.axis(tracks, start, end, rate)
    checks.long_enough(name, axis)
    data = _fill(name, ticks.bridged(tracks, own_rate), robot, axis)
    if sparse:
        data |= slow.commands(sparse, axis, robot, data)
        messages.append(slow.note(sparse, own_rate, robot))
    data |= {"resolution": observe.steps(tracks), "stamps": observe.stamps(tracks),
             "late": float(max(delays)), "trusted": trust_units, **attributes}  # fmt: skip
    messages += observe.notes(tracks, rate, CUTS.silence) + observe.above_limits(tracks, robot)
    result = Record(name, axis - axis[0], **data)
    if result.simulated > FINE_STEP:
        messages.append(STEPS.format(1e3 * result.simulated))
    if judge and not trust_units:
        suspect.units(result, robot)
    data |= {"notes": (*messages, *lags.notes(result)), "warnings": tuple(lags.warnings(result))}
    return Record(name, result.t, **data)


def _ordered(name: str, track: Track, notes: list[str]) -> Track:
    """The track with increasing time stamps, without duplicates."""
    if np.all(np.diff(track.t) > 0.0):
        return track
    for row in cuts.cut_rows([track]):
        raise ParameterError(
            f"{name}: the time of {track.label} jumps back by "
            f"{track.t[row - 1] - track.t[row]:.6g} s at row {row}: are there several experiments "
            "in one file? Cut them with rows: [first, stop]"
        )
    t, first, inverse = np.unique(track.t, return_index=True, return_inverse=True)
    duplicates = len(track.t) - len(t)
    if duplicates and np.array_equal(track.x[first][inverse], track.x):
        add_note(notes, f"{duplicates} samples repeat another, with its stamp: they were left out")
    elif duplicates:
        add_note(notes, Doubt(f"{duplicates} samples with the stamp of another were left out"))
    if np.any(np.diff(track.t) < 0.0):
        late = int(np.sum(np.diff(track.t) < 0.0))
        row = int(np.argmin(np.diff(track.t)))
        add_note(
            notes,
            Doubt(
                f"samples were not in the order of their stamps and were sorted: {late} times, the "
                f"furthest back by {track.t[row] - track.t[row + 1]:.6g} s at row {row + 1}"
            ),
        )
    return replace(track, t=t, x=track.x[first])


def _one_sheet(tracks: list[Track]) -> list[Track]:
    """Quaternions without sign changes between neighbours; q and -q are the same rotation."""
    for role in ("orientation", "base_orientation"):
        parts = [k for k in tracks if k.role == role]
        if parts and all(np.array_equal(k.t, parts[0].t) for k in parts):
            x = np.stack([k.x for k in parts], axis=1)
            flips = np.sum(x[1:] * x[:-1], axis=1) < 0.0
            sign = np.cumprod(np.concatenate([[1.0], np.where(flips, -1.0, 1.0)]))
            flipped = [replace(k, x=sign * k.x) for k in parts]
            tracks = [k for k in tracks if k.role != role] + flipped
    return tracks


def add_note(notes: list[str], note: str) -> None:
    """Append a note unless it is there."""
    if note not in notes:
        notes.append(note)


def _needed(track: Track) -> bool:
    return track.role == "q" or track.role.startswith("command_")


def _overlap(name: str, tracks: Sequence[Track]) -> tuple[float, float]:
    """First and last time that both angles and commands cover [s]."""
    spans = {}
    for what, group in (
        ("measured", [k for k in tracks if k.role == "q"]),
        ("commanded", [k for k in tracks if k.role.startswith("command_")]),
    ):
        first, last = max(k.t[0] for k in group), min(k.t[-1] for k in group)
        if what == "commanded":  # the last command holds as long as the longest earlier one
            last += max(1.5 * float(np.max(np.diff(k.t), initial=0.0)) for k in group)
        spans[what] = (float(first), float(last))
    start = max(first for first, _ in spans.values())
    end = min(last for _, last in spans.values())
    if not end > start:
        listing = " and ".join(f"{k} from {a:.3f} to {b:.3f} s" for k, (a, b) in spans.items())
        raise ParameterError(
            f"{name}: angles and commands have no time in common ({listing}); are their clocks the "
            "same? In a bag, clock: log at the columns of both takes the times of logging"
        )
    return start, end


def _unused(tracks: Sequence[Track], start: float, end: float) -> list[str]:
    """Notes on times of angles or commands that the others do not cover."""
    notes = []
    for what, group in (
        ("positions", [k for k in tracks if k.role == "q"]),
        ("commands", [k for k in tracks if k.role.startswith("command_")]),
    ):
        opposite = {"positions": "commands", "commands": "positions"}[what]
        for time, when in (
            (start - max(k.t[0] for k in group), f"begin {{:.2f}} s before the {opposite}"),
            (min(k.t[-1] for k in group) - end, f"go on {{:.2f}} s after the {opposite}"),
        ):
            if time > CUTS.pause:
                notes.append(Doubt(f"{what} {when.format(time)}: that time is not used"))
    return notes


def _rate(tracks: Sequence[Track], robot: Robot) -> float:
    """The higher of the rates of angles and commands; rounded where time stamps jitter."""
    finest = min(
        (k for k in tracks if _needed(k) and len(k.t) > 1), key=lambda k: ticks.period(k.t)
    )
    rate, step = 1.0 / ticks.period(finest.t), np.diff(finest.t)
    even = float(np.ptp(step)) < 1e-6 * float(np.median(step)) + 2e-9
    for meant in (robot.control_rate, 10.0 * round(0.1 * rate)):
        if meant > 0.0 and abs(rate - meant) < (1e-6 if even else ROUND) * rate:
            return meant
    return rate


def _fill(
    name: str, tracks: Sequence[Track], robot: Robot, axis: np.ndarray
) -> dict[str, dict | tuple]:
    """Arrays of a `Record`, and the names of their columns."""
    by = {(k.role, k.place): k for k in tracks}
    joints = tuple(j for j in robot.joints if ("q", j) in by)
    feet = tuple(f for f in robot.feet if ("grf", f) in by)
    inputs = {k: _columns(by, k, ("",), axis, ticks.hold, 1.0) for k in INPUTS if (k, "") in by}
    stance = {f: ticks.hold(by["stance", f], axis) for f in robot.feet if ("stance", f) in by}
    return {
        "joints": joints,
        "feet": feet,
        "inputs": {kind: column[:, 0] for kind, column in inputs.items()},
        "stance": stance,
        **_commands(by, robot, axis),
        **_signals(name, by, joints, feet, axis),
    }


def _commands(by: dict, robot: Robot, axis: np.ndarray) -> dict[str, dict | tuple]:
    """Commands of a `Record`, their joints, and the kinds that are linear between samples."""
    roles = {role for role, _ in by}
    commanded = {place for role, place in by if role.startswith("command_")}
    driven = tuple(robot.joints[i] for i in robot.driven if robot.joints[i] in commanded)
    sent = [kind for kind in COMMANDS if f"command_{kind}" in roles]
    lines = {role for (role, _), track in by.items() if track.between == "line"}
    return {
        "driven": driven,
        "command": {k: _columns(by, f"command_{k}", driven, axis, ticks.hold, 0.0) for k in sent},
        "ramps": tuple(kind for kind in sent if f"command_{kind}" in lines),
    }


def _signals(
    name: str, by: dict, joints: tuple[str, ...], feet: tuple[str, ...], axis: np.ndarray
) -> dict[str, dict]:
    """Signals of a `Record`, flags of those that were lost, and times by which they were moved."""
    signals, guessed, moved = {}, {}, {}
    for role in (*JOINT_SIGNALS, *WIDTHS, "grf"):
        if not any(r == role for r, _ in by):
            continue
        names = joints if role in JOINT_SIGNALS else feet if role == "grf" else AXES[role]
        signals[role] = _columns(by, role, names, axis, ticks.sample, np.nan)
        if role in JOINT_SIGNALS:
            guessed[role] = _columns(by, role, names, axis, ticks.lost, 0.0) > 0.0
            moved[role] = _columns(by, role, names, axis, ticks.moved, 0.0)
    for role in ("orientation", "base_orientation"):
        if role in signals:
            signals[role] = _unit_length(name, role, signals[role])
    lossy = {role: flags for role, flags in guessed.items() if flags.any()}
    moved = {role: late for role, late in moved.items() if late.any()}
    return {"signals": signals, "guessed": lossy, "moved": moved}


def _columns(by: dict, role: str, names: Sequence[str], axis: np.ndarray, how: Any, without: float):
    """Tracks of a role as columns, (T, places)."""
    columns = np.full((len(axis), len(names)), without)
    for i, place in enumerate(names):
        if (role, place) in by:
            columns[:, i] = how(by[role, place], axis)
    return columns


def _unit_length(name: str, role: str, quaternion: np.ndarray) -> np.ndarray:
    """Quaternions normalised to length 1, since interpolation shortens them.

    Raises:
        ParameterError: The values are no quaternions.
    """
    length = np.linalg.norm(quaternion, axis=1, keepdims=True)
    valid = np.isfinite(length[:, 0])
    if np.any(np.abs(length[valid] - 1.0) > 0.1):
        extreme = float(length[valid][np.argmax(np.abs(length[valid] - 1.0))][0])
        raise ParameterError(
            f"{name}: {role} must be quaternions x, y, z, w of length 1, one has {extreme:.3f}"
        )
    return quaternion / length
