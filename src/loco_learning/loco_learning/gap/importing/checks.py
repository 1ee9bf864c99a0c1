# SPDX-License-Identifier: Apache-2.0
"""Checks of a recording before anything is computed from it, with one line per mistake."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from loco_control.exceptions import ParameterError
from loco_sim.robot.robot import Robot

from ..recordings.mapping import ROLES
from ..recordings.record import JOINT_SIGNALS, WIDTHS, Doubt
from ..recordings.tracks import Track

MIN_SAMPLES = 50
MIN_DURATION = 0.25  # [s]
_MEASURED = (*JOINT_SIGNALS, *WIDTHS, "grf")
REQUIRED = ("q", "command_position", "command_velocity", "command_torque")


def present(name: str, tracks: Sequence[Track], robot: Robot) -> None:
    """Check that roles and joints are those of the robot.

    Raises:
        ParameterError: The robot has no such joint or foot, or a role is missing or duplicated.
    """
    _no_strangers(name, tracks, robot)
    sources: dict[tuple[str, str], str] = {}
    for track in tracks:
        other = sources.setdefault((track.role, track.place), track.source)
        if other != track.source:
            raise ParameterError(
                f"{name}: {track.label} is given twice, by {other} and by {track.source}"
            )
    roles = {track.role for track in tracks}
    listed = ", ".join(sorted(roles)) or "none"
    if "q" not in roles:
        hint = "; for want of angles, add a column with the integral of the velocity"
        raise ParameterError(
            f"{name}: role q (measured positions) is missing; it has {listed}"
            f"{hint * ('dq' in roles)}"
        )
    if not any(role.startswith("command_") for role in roles):
        joints = ", ".join(robot.joints[i] for i in robot.driven)
        hint = (
            "; if the measured torque moved the robot, its role is command_torque"
            if "tau" in roles
            else f"; if nothing drove the robot, add to the mapping: undriven: [{joints}]"
        )
        wanted = ", ".join(REQUIRED[1:])
        raise ParameterError(
            f"{name}: a command is missing (one of {wanted}); it has {listed}{hint}"
        )
    for index in robot.driven:
        _commanded(name, robot.joints[index], set(sources), robot)


def _no_strangers(name: str, tracks: Sequence[Track], robot: Robot) -> None:
    for what, allowed in (("joint", robot.joints), ("foot", robot.feet)):
        names = [t.place for t in tracks if ROLES[t.role][1] == what]
        strangers = sorted(set(names) - set(allowed))
        if strangers:
            plural = {"joint": "joints", "foot": "feet"}[what]
            raise ParameterError(
                f"{name}: its {plural} {', '.join(strangers)} are not those of robot "
                f"{robot.name!r} ({', '.join(allowed) or 'none'}); choose the robot that was "
                "measured, or name columns and joints in a mapping"
            )


def _commanded(name: str, joint: str, present: set[tuple[str, str]], robot: Robot) -> None:
    """Check that the joint has the command that its drive needs."""
    roles = [role for role in REQUIRED[1:] if (role, joint) in present]
    needed = getattr(robot.drives.get(joint), "command", "position")
    if f"command_{needed}" not in roles:
        hint = f"; if nothing moved it, add to robot.yaml: locked: {{{joint}: 0}}"
        hint = "" if roles or robot.legs is not None else hint
        raise ParameterError(
            f"{name}: role command_{needed} of joint {joint} is missing, which robot "
            f"{robot.name!r} drives by {needed}; this joint has {', '.join(roles) or 'no command'}"
            f"{hint}"
        )


def measured(name: str, tracks: Sequence[Track], notes: list[str]) -> list[Track]:
    """Tracks that have values; one of NaN only, or of a rate or torque of 0, was not measured.

    Drivers write NaN where they read nothing: such readings of what was measured are left out.

    Raises:
        ParameterError: Commands, stamps or infinite values are not numbers, or a required track has
            no value.
    """
    retained = []
    for track in tracks:
        nan = ~np.isfinite(track.x) | ~np.isfinite(track.t)
        no_reading = np.isnan(track.x) & np.isfinite(track.t) & (track.role in _MEASURED)
        if track.role in ("dq", "tau") and len(track.x) and not track.x.any():
            notes.append(f"{track.label} is 0 all the time and counts as not measured")
        elif nan.all() and track.role not in REQUIRED:
            notes.append(f"{track.label} has no values and counts as not measured")
        elif nan.all():
            raise ParameterError(_no_values(name, track))
        elif (nan & ~no_reading).any():
            nan &= ~no_reading
            row = int(np.argmax(nan))
            what = "values" if np.isfinite(track.t[row]) else "stamps"
            raise ParameterError(
                f"{name}: {track.label} has {int(nan.sum())} {what} of {len(nan)} that are NaN or "
                f"infinite, the first in row {row} ({track.source}); leave those rows out"
            )
        else:
            if nan.any():
                count = f"{int(nan.sum()):,} of {len(nan):,}"
                notes.append(Doubt(f"{track.label}: {count} readings are NaN and count as none"))
            retained.append(replace(track, t=track.t[~nan], x=track.x[~nan]))
            if track.empty:
                notes.append(
                    f"{track.label}: {len(track.x)} readings, each on its own stamp; "
                    f"{track.empty} empty cells are none"
                )
    return retained


def _no_values(name: str, track: Track) -> str:
    """Message for a required signal without a number."""
    if not len(track.x):
        what, hint = "no samples in the rows and times asked for", ""
    else:
        what = "only NaN"
        hint = f"; if it was not connected and never moved, add to robot.yaml: locked: " \
               f"{{{track.place}: 0}}" if track.role == "q" else ""  # fmt: skip
    return f"{name}: {track.label} has {what} ({track.source}){hint}"


def moving(name: str, tracks: Sequence[Track]) -> None:
    """Check that some joint moved, and every joint whose command moves.

    Raises:
        ParameterError: All positions are constant, or that of a joint with a changing command.
    """
    positions = [track for track in tracks if track.role == "q"]
    fixed = [track for track in positions if np.ptp(track.x) == 0.0]
    if len(fixed) == len(positions):
        raise ParameterError(
            f"{name}: the measured position of {', '.join(t.place for t in fixed)} is constant at "
            f"{fixed[0].x[0]:g}: nothing moved, or this is the wrong column"
        )
    commanded = {t.place for t in tracks if t.role == "command_position" and np.ptp(t.x) > 0.0}
    for track in fixed:
        if track.place in commanded:
            raise ParameterError(
                f"{name}: the measured position of {track.place} is constant at {track.x[0]:g} "
                "while its command moves: a dead sensor, or the wrong column"
            )


def long_enough(name: str, axis: np.ndarray) -> None:
    """Check that the recording is long enough.

    Raises:
        ParameterError: Fewer than `MIN_SAMPLES` samples, or less than `MIN_DURATION`.
    """
    duration = float(axis[-1] - axis[0]) if len(axis) else 0.0
    if len(axis) < MIN_SAMPLES or duration < MIN_DURATION:
        raise ParameterError(
            f"{name}: angles and commands have {len(axis)} samples over {duration:.3f} s in "
            f"common, too short: at least {MIN_SAMPLES} and {MIN_DURATION} s are needed"
        )
