# SPDX-License-Identifier: Apache-2.0
"""Properties of raw signals before resampling: gaps, quantisation, saturation, wrapped angles."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from loco_sim.robot.description import Description
from loco_sim.robot.robot import Robot

from ..recordings.record import Doubt
from ..recordings.tracks import INPUTS, Track, quantum

TURN = 2.0 * np.pi
STUCK = 5  # consecutive samples at the largest value that are not by chance
CLIPPED = 0.01  # share of samples at the largest value above which a signal is clipped
DEVIATION = 1.4826  # standard deviation of a normal law over its median absolute value
BEYOND = 1.1  # torque over the limit of the model from which on it is above it (taste)
FIRST = 5.0  # first step of a position over the largest later one, beyond a motion (taste)
FLICKER = 0.01  # step over the largest motion, below which it may be one of an encoder (taste)
LEVELS = 20  # a signal of fewer different values is a switch, not a clipped one


def without_placeholder(tracks: list[Track], messages: list[str]) -> list[Track]:
    """Signals of joints without a first row of zeros, written before anything was read.

    Args:
        tracks: All signals, with increasing time stamps.
        messages: List to which a sentence is appended on such a row, and on any first position far
            from the second.
    """
    positions = [k for k in tracks if k.role == "q" and len(k.x) > LEVELS]
    flicker = FLICKER * max((float(np.ptp(k.x[1:])) for k in positions), default=0.0)
    jumps = []
    for track in positions:
        steps = np.abs(np.diff(track.x))
        if steps[0] > max(FIRST * np.max(steps[1:]), flicker):
            jumps.append(f"{track.label} by {steps[0]:.3g}")
    if not jumps:
        return tracks
    if len(positions) == 1 or any(track.x[0] for track in positions):
        messages.append(
            Doubt(
                f"the first reading is far from the second, {', '.join(jumps)}, beyond all later "
                "steps: if it is none, leave it out with rows: [1, null]"
            )
        )
        return tracks
    messages.append(Doubt("the first reading of all joints is 0, far from the others: left out"))
    start = positions[0].t[0]
    return [replace(k, t=k.t[1:], x=k.x[1:])
            if k.role in ("q", "dq", "tau") and k.t[0] == start and k.x[0] == 0.0 else k
            for k in tracks]  # fmt: skip


def unwrapped(track: Track, robot: Robot, notes: list[str]) -> Track:
    """An angle without jumps of a whole turn between neighbours; other signals unchanged."""
    if track.role not in ("q", "command_position") or len(track.x) < 2:
        return track
    if Description(robot.urdf).joint_types().get(track.place) == "prismatic":
        return track
    step = np.diff(track.x)
    jump = np.abs(np.abs(step) - TURN) < 1.0
    if not jump.any() or np.max(np.abs(step[~jump]), initial=0.0) > 2.0:
        return track
    if track.role == "command_position" and np.ptp(track.x) > 1.05 * TURN:
        return track  # a command may really step by a turn
    turns = f"{int(jump.sum())} jumps of a turn were undone"
    notes.append(Doubt(f"{track.label} was wrapped: {turns}"))
    return replace(track, x=np.unwrap(track.x))


def beside_command(track: Track, tracks: Sequence[Track], messages: list[str]) -> Track:
    """An unwrapped position in the turn of its command; other signals unchanged.

    Args:
        track: Signal of a joint.
        tracks: All signals, with increasing time stamps.
        messages: List to which a sentence is appended for a position that was in another turn.
    """
    command = next((k for k in tracks if k.role == "command_position" and k.place == track.place),
                   None)  # fmt: skip
    if track.role != "q" or command is None:
        return track
    error = track.x - np.interp(track.t, command.t, command.x)
    turns = round(float(np.median(error)) / TURN)
    if turns:
        messages.append(
            Doubt(f"{track.label} was {turns} turns from its command: they were taken off")
        )
    return replace(track, x=track.x - TURN * turns)


def notes(tracks: Sequence[Track], rate: float, gap: float) -> list[str]:
    """Peculiarities of time stamps and values, a sentence each.

    Args:
        tracks: Signals with increasing time stamps.
        rate: Rate of the common axis [Hz].
        gap: Smallest length of a gap, in sampling periods.
    """
    messages: list[str] = []
    axes: dict[bytes, list[Track]] = {}
    for track in tracks:
        axes.setdefault(track.t.tobytes(), []).append(track)
    for group in axes.values():
        messages += _stamps(group, rate, gap)
    for track in tracks:
        messages += _saturated(track)
    resolutions = {(t.role, t.place): quantum(t) or 0.0 for t in tracks}
    for role in dict.fromkeys(role for role, _ in resolutions):
        sizes = [size for (r, _), size in resolutions.items() if r == role and size > 0.0]
        if sizes:
            messages.append(f"{role} is quantised in steps of {max(sizes):.4g}")
    return list(dict.fromkeys(messages))


def steps(tracks: Sequence[Track]) -> dict[tuple[str, str], float]:
    """Quantisation step per measured signal and joint (or axis); 0 if no step is detected.

    Signals that hardly change are left out, since their step cannot be determined.
    """
    measured = [
        track
        for track in tracks
        if not track.role.startswith("command_") and track.role not in INPUTS
    ]
    sizes = {(track.role, track.place): quantum(track) for track in measured}
    return {of: step for of, step in sizes.items() if step is not None}


def stamps(tracks: Sequence[Track]) -> dict[str, dict[str, float]]:
    """Sampling properties of the worst track of each role, see `Record.stamps`."""
    by_role: dict[str, dict[str, float]] = {}
    for track in tracks:
        step = np.diff(track.t)
        if len(step) < 2:
            continue
        usual = float(np.median(step))
        count = np.maximum(np.round(step / usual), 1.0)
        jitter = np.median(np.abs(step - usual * count)) * DEVIATION / np.sqrt(2.0)  # two stamps
        one = {"rate": 1.0 / usual, "jitter_ms": round(1e3 * float(jitter), 6),  # of stamps in ns
               "missing": float(np.sum(count - 1.0)), "silence": float(step.max())}  # fmt: skip
        current = by_role.setdefault(track.role, one)
        if (one["missing"], one["jitter_ms"]) > (current["missing"], current["jitter_ms"]):
            by_role[track.role] = one
    return by_role


def _stamps(tracks: Sequence[Track], rate: float, gap: float) -> list[str]:
    """Notes on pauses and jitter of tracks with common time stamps."""
    messages, t = [], tracks[0].t
    step = np.diff(t)
    if len(step) < 2:
        return messages
    who = ", ".join(dict.fromkeys(track.role for track in tracks))
    usual = float(np.median(step))
    pauses = np.flatnonzero(step > gap * usual)
    if len(pauses) and not all(track.role.startswith("command_") for track in tracks):
        longest = pauses[np.argmax(step[pauses])]
        messages.append(
            Doubt(
                f"{who}: {len(pauses)} pauses, the longest of {step[longest]:.3f} s at "
                f"{t[longest] - t[0]:.2f} s; nothing is known there"
            )
        )
    low, high = np.percentile(step, [5.0, 95.0])
    if high - low > 0.05 * usual:
        messages.append(
            f"{who}: uneven stamps, {1e3 * low:.2f} to {1e3 * high:.2f} ms apart, resampled at "
            f"{rate:.6g} Hz"
        )
    return messages


def above_limits(tracks: Sequence[Track], robot: Robot) -> list[str]:
    """Notes on measured torques that the model cannot give, since its limit of the joint is lower.

    Args:
        tracks: Signals of the robot.
        robot: Robot of the model.
    """
    messages = []
    for track in tracks:
        if track.role != "tau" or track.place not in robot.drives or track.place in robot.springs:
            continue
        limit = float(robot.effort[robot.joints.index(track.place)])
        reached = float(np.percentile(np.abs(track.x[np.isfinite(track.x)]), 99.0))
        if reached > BEYOND * limit > 0.0:
            text = f"{track.label} reaches {reached:.4g}, and the effort limit of the model is "
            messages.append(Doubt(f"{text}{limit:.4g}: which of them is wrong?"))
    return messages


def _saturated(track: Track) -> list[str]:
    """Notes on a measured signal that saturates at its largest or smallest value."""
    if track.role.startswith("command_") or track.role in ("q", *INPUTS):
        return []
    if len(np.unique(track.x)) < LEVELS:
        return []
    messages, size = [], np.max(np.abs(track.x))
    for what, limit in (("largest", np.max(track.x)), ("smallest", np.min(track.x))):
        at = track.x == limit
        edges = np.flatnonzero(np.diff(np.concatenate([[False], at, [False]])))
        longest = np.max(edges[1::2] - edges[::2])
        if np.mean(at) > CLIPPED and longest >= STUCK and abs(limit) > 0.5 * size:
            share = f"for {100.0 * np.mean(at):.1f} % of the time: cut off there?"
            messages.append(Doubt(f"{track.label} is at its {what} value {limit:.4g} {share}"))
    return messages
