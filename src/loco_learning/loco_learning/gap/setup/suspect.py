# SPDX-License-Identifier: Apache-2.0
"""Detection of wrong units by comparing signals with each other and with the robot's limits.

A hidden effect changes a signal by a tenth or a half; a wrong unit by a factor of 57, 9.5 or 1000.
The limits lie between.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np

from loco_control.exceptions import ParameterError
from loco_sim.drives.spring_kernels import spring_torques
from loco_sim.robot.description import Description
from loco_sim.robot.robot import Robot
from loco_sim.robot.servo import TorqueDrive

from ..recordings.lags import is_constant, rates
from ..recordings.record import Record, bridged, spacing
from ..recordings.tracks import Track
from ..recordings.units import TURN, factor
from .finding import MAPPING, OFFSET, SCALE, SIGN, UNIT, Change, Finding, unit_of

DEGREE = 180.0 / np.pi
SLOWEST, FASTEST = 4.0, 2e4  # range of plausible sampling rates [Hz]
REPEATED = 0.75  # share of steps of 0 above which a time lost its digits; three publishers have 2/3
RATIO_NEAR = 0.12  # largest distance of a ratio to a known one [log]
ENCODER_NEAR = 0.05  # the same, for counts of an encoder, a power of two a turn
COARSEST = 0.5  # largest step of a measured position [rad or m]; larger ones are counts (taste)
BOTH_WAYS = 0.1  # share of samples of either sign above which a signal changes sign
POWERS = {"mN m": 1e-3, "N cm": 1e-2, "kN m": 1e3}  # units of torques [N·m]
TENTH = 0.3  # largest distance of a ratio to a power of ten [log]: friction and rotors, no unit
RATIO_FAR = 3.0  # ratio that no effect causes
# The same of signals with this correlation; gains of 30 % too much and too little make 1.86.
RATIO_CLEAR, CLEAR = 1.9, 0.99
SMOOTH = 0.5  # largest difference of neighbours over the deviation of a course (taste)
UNRELATED = 0.5  # correlation below which a velocity is none of its position (taste)
DELAYED = 3  # longest delay of a velocity that is tried [samples of 30 ms] (taste)
BELIEVE = "; if it is right as it is, say trust_units: true in the mapping"

# Measured velocity over the derivative of the angle, and what it means.
RATIOS = {
    DEGREE: "dq is in deg/s (or q in rad is read as deg)",
    1.0 / DEGREE: "q is in deg (or dq is in rad/s and read as deg/s)",
    60.0 / (2.0 * np.pi): "dq is in rpm",
    1.0 / (2.0 * np.pi): "dq is in rev/s",
    2.0 * np.pi: "q is in rev (or dq is in rad/s and read as rev/s)",
    1e3: "the time is in ms (or dq in mrad/s)",
    1e-3: "the time is in s and read as ms (or q in mrad)",
    1e6: "the time is in us",
    1e9: "the time is in ns",
}
# Role, key and value of the correcting line, where one column alone is wrong.
MEND = {
    RATIOS[DEGREE]: ("dq", UNIT, "deg/s"),
    RATIOS[1.0 / DEGREE]: ("q", UNIT, "deg"),
    RATIOS[2.0 * np.pi]: ("q", UNIT, "rev"),
    RATIOS[60.0 / (2.0 * np.pi)]: ("dq", UNIT, "rpm"),
    RATIOS[1.0 / (2.0 * np.pi)]: ("dq", UNIT, "rev/s"),
}


def times(name: str, tracks: list[Track]) -> None:
    """Check that the time stamps rise, with a plausible sampling rate.

    Raises:
        ParameterError: The time does not rise, or the sampling rate is implausible.
    """
    for track in tracks:
        if track.role != "q" or len(track.t) < 3:
            continue
        steps = np.diff(track.t)
        step = float(np.median(np.abs(steps)))
        news = (steps != 0.0) | (np.diff(track.x) != 0.0)  # a row may be logged several times
        if news.any() and np.mean(steps[news] == 0.0) > REPEATED:
            raise ParameterError(
                f"{name}: the time of {track.label} does not rise in most rows (of {len(track.t)} "
                f"stamps {len(np.unique(track.t))} differ): was it written with too few digits?"
            )
        if step > 0.0 and not SLOWEST <= 1.0 / step <= FASTEST:
            fits = [
                unit
                for unit, size in (("ms", 1e-3), ("us", 1e-6), ("ns", 1e-9), ("s", 1e3))
                if 10.0 <= 1.0 / (step * size) <= 1e4
            ]
            units = " or ".join(fits) or "another unit"
            raise ParameterError(
                f"{name}: {track.label} has a sample each {step:g} s: the time is probably in "
                f"{units}, say time: {{unit: {fits[0] if fits else 'ms'}}}{BELIEVE}"
            )


def units(record: Record, robot: Robot) -> None:
    """Reject a record in which a unit is probably wrong.

    Raises:
        ParameterError: A unit is probably wrong; the message names it.
    """
    for finding in findings(record, robot):
        raise ParameterError(f"{record.name}: {finding.says}{BELIEVE}")


def findings(record: Record, robot: Robot) -> Iterator[Finding]:
    """Probably wrong units, from comparing signals with each other and with the robot's limits."""
    description = Description(robot.urdf)
    types = description.joint_types()
    for joint in record.joints:
        turning = types.get(joint) != "prismatic"
        of_speed = list(_velocity(record, joint, turning, description))
        is_known = any(change.role == "q" for one in of_speed for change in one.mends)
        step = record.resolution.get(("q", joint)) or 0.0
        if step > COARSEST and not is_known:
            scale = "2pi/4096 if 4096 are a turn" if turning else "1e-6 if they are micrometres"
            yield _of_unit(f"q of {joint} has steps of {step:.3g} {'rad' if turning else 'm'}: "
                           f"probably counts; give their scale, {scale}", joint)  # fmt: skip
            continue
        yield from of_speed
        if not is_known:
            yield from _command(record, joint, description) if turning else ()
            yield from _limits(record, joint, turning, description)
    yield from _torque(record, robot)
    yield from _unsigned(record)
    yield from _imu(record)
    yield from _inputs(record)


def _of(record: Record, signal: str, joint: str) -> np.ndarray | None:
    if signal not in record.signals or joint not in record.joints:
        return None
    return record.signals[signal][:, record.joints.index(joint)]


def _of_angles(record: Record, joint: str, note: str, key: str, value: Any) -> Finding:
    """Finding that positions have a wrong unit, with all that has it as well.

    Velocities have it if they are the derivative of the positions, and commands if they are as
    large.
    """
    q, command = _of(record, "q", joint), record.command.get("position")
    roles = ["q", *["dq"] * _same(*_speeds(record, joint))]
    if command is not None and joint in record.driven:
        k = record.driven.index(joint)
        if np.nanstd(command[:, k]) > np.nanstd(q) / RATIO_FAR:
            roles.append("command_position")
            velocity = record.command.get("velocity", np.zeros(command.shape))[:, k]
            rate = rates(command[:, k], record.dt)
            roles += ["command_velocity"] * _same(*slope(rate, velocity))
    return Finding("unit", (joint,), note, tuple(
        Change(MAPPING, key, unit_of(value, role) if key == UNIT else value, role, joint)
        for role in roles))  # fmt: skip


def _same(by: float, correlation: float) -> bool:
    """Whether two signals are one in one unit, by their ratio and correlation."""
    return correlation > 0.8 and bool(abs(np.log(by)) < RATIO_NEAR)


def _of_unit(
    note: str, joint: str = "", role: str = "", key: str = UNIT, value: Any = ""
) -> Finding:
    """Finding of a wrong unit, with the correcting line if one is known."""
    mends = (Change(MAPPING, key, value, role, joint),) if value else ()
    return Finding("unit", (joint,) if joint else (), note, mends)


def slope(x: np.ndarray, y: np.ndarray) -> tuple[float, float]:
    """Ratio of the standard deviations of y and x, signed by their correlation; correlation."""
    valid = np.isfinite(x) & np.isfinite(y)
    x, y = x[valid], y[valid]
    if valid.sum() < 20 or is_constant(x) or is_constant(y):
        return 1.0, 0.0
    x, y = x - np.mean(x), y - np.mean(y)
    correlation = float(np.sum(x * y) / np.sqrt(np.sum(x * x) * np.sum(y * y)))
    return float(np.copysign(np.std(y) / np.std(x), correlation)), correlation


def _smooth(x: np.ndarray, width: int) -> np.ndarray:
    """Means of consecutive blocks of `width` samples."""
    count = len(x) // width
    return x[: count * width].reshape(count, width).mean(axis=1)


def _speeds(record: Record, joint: str) -> tuple[float, float]:
    """Ratio of the measured velocity to the derivative of the position, and their correlation."""
    speeds = _both_speeds(record, joint)
    return slope(*speeds) if speeds else (1.0, 0.0)


def _both_speeds(record: Record, joint: str) -> tuple[np.ndarray, np.ndarray] | None:
    """Means of the derivative of the position and of the measured velocity, (K,) each.

    None if one is not measured, or if hardly two samples a radian were: then no difference or mean
    is of the motion.
    """
    dq, q = _of(record, "dq", joint), _of(record, "q", joint)
    rows = [] if dq is None or q is None else np.flatnonzero(np.isfinite(q))  # some in a slow log
    if len(rows) < 2:
        return None
    step = spacing(rows)
    pairs = rows[:-1][np.diff(rows) == step]  # no pauses
    dt, steps = step * record.dt, (q[pairs + step] - q[pairs]) / (step * record.dt)
    width = max(1, min(round(0.03 / dt), len(pairs) // 40))
    speeds = _smooth(steps, width)
    if width == 1 and not _is_smooth(speeds, 1.0):
        return None
    return speeds, _smooth(0.5 * (dq[pairs] + dq[pairs + step]), width)


def _is_smooth(x: np.ndarray, limit: float) -> bool:
    """Whether neighbours differ by less than a share of the deviation: no noise, but a course."""
    return bool(np.std(np.diff(x)) <= limit * np.std(x))


def _velocity(
    record: Record, joint: str, turning: bool, description: Description
) -> Iterator[Finding]:
    """Compare the measured velocity with the derivative of the measured position.

    Of the two, angles outside the joint limits are wrong if the ratio brings them inside.
    """
    (ratio, correlation), q = _speeds(record, joint), _of(record, "q", joint)
    if abs(correlation) < 0.8:
        yield from _unrelated(record, joint)
        return
    by = abs(ratio)
    if turning and _outside(q, joint, description) and not _outside(by * q, joint, description):
        unit, key, value = _unit_of_angle(by)
        note = f"dq of {joint} is {by:.3g} times the derivative of q, and q is outside the joint " \
               f"limits: probably q is in {unit}"  # fmt: skip
        yield _of_angles(record, joint, note, key, value)
        return
    milli, rate = "mrad" if turning else "mm", (1.0 - RATIO_NEAR) / record.dt
    text = f"dq of {joint} is {by:.3g} times the derivative of q: probably"
    if abs(np.log(by / 1e3)) < RATIO_NEAR and 1e3 * rate > FASTEST:  # not the time in ms
        yield _of_unit(f"{text} dq is in {milli}/s", joint, "dq", UNIT, f"{milli}/s")
        return
    if abs(np.log(by * 1e3)) < RATIO_NEAR and 1e-3 * rate < SLOWEST:  # nor read as ms
        yield _of_angles(record, joint, f"{text} q is in {milli}", UNIT, milli)
        return
    for size, meaning in RATIOS.items():
        if abs(np.log(by / size)) < RATIO_NEAR and (turning or size in (1e3, 1e-3)):
            yield _of_unit(f"{text} {meaning}", joint, *MEND.get(meaning, ()))
            return
    if ratio < 0.0:
        yield _of_unit(f"dq of {joint} has the opposite sign of the derivative of q: sign of one",
                       joint, "dq", SIGN, -1)  # fmt: skip
    elif not 1.0 / RATIO_FAR < ratio < RATIO_FAR:
        yield _of_unit(f"dq of {joint} is {ratio:.3g} times the derivative of q: a wrong unit or "
                       "scale of one, or of the time", joint, "dq", SCALE, 1.0 / ratio)  # fmt: skip
    elif correlation > CLEAR and not 1.0 / RATIO_CLEAR < ratio < RATIO_CLEAR:
        speeds = map(lambda j: _speeds(record, j), record.joints)
        right = any(c > CLEAR and abs(np.log(x / ratio)) > RATIO_NEAR for x, c in speeds)
        clock = ", as other joints refute a wrong clock" if right else (
            f" (scale: {1.0 / ratio:.4g} at dq), or a clock that runs {ratio:.3g} times too fast "
            f"(time: {{scale: {1.0 / ratio:.4g}}})")  # fmt: skip
        yield _of_unit(f"dq of {joint} is {ratio:.3g} times the derivative of q: a wrong scale of "
                       f"one{clock}", joint, "dq", SCALE, right / ratio)  # fmt: skip


def _unrelated(record: Record, joint: str) -> Iterator[Finding]:
    """A measured velocity with a course of its own, at no delay that of the position."""
    speeds = _both_speeds(record, joint)
    if speeds is None or not all(len(x) > 20 and _is_smooth(x, SMOOTH) for x in speeds):
        return
    derivative, dq = speeds
    shifts = range(-DELAYED, DELAYED + 1)
    corr = max((slope(derivative[DELAYED:-DELAYED], np.roll(dq, k)[DELAYED:-DELAYED])[1]
                for k in shifts), key=abs)  # fmt: skip
    same = slope(_of(record, "q", joint), _of(record, "dq", joint))[1] > CLEAR
    if same or abs(corr) < UNRELATED:
        what = "but a multiple of q" if same else f"correlation {corr:.2f} at the best delay"
        yield _of_unit(f"dq of {joint} is not the derivative of q, {what}: name its column, or "
                       "leave it out of the mapping", joint)  # fmt: skip


def _unit_of_angle(by: float) -> tuple[str, str, Any]:
    """Name of a unit of `by` rad, with key and value of the line for it."""
    for unit in ("deg", "mrad"):
        if abs(np.log(by / factor(unit))) < RATIO_NEAR:
            return unit, UNIT, unit
    counts = 2.0 ** np.round(np.log2(TURN / by))
    if abs(np.log(by * counts / TURN)) < ENCODER_NEAR:
        return f"counts of {counts:g} a turn", SCALE, float(TURN / counts)
    return "a unit of this size", SCALE, by


def _command(record: Record, joint: str, description: Description) -> Iterator[Finding]:
    """Compare commanded and measured angle: one may be in degrees."""
    command, q = record.command.get("position"), _of(record, "q", joint)
    if command is None or q is None or joint not in record.driven:
        return
    command = command[:, record.driven.index(joint)]
    std = np.nanstd(command), np.nanstd(q)
    if min(std) == 0.0 or not 30.0 < max(std) / min(std) < 100.0:
        return
    large, values = ("command_position", command) if std[0] > std[1] else ("q", q)
    if _outside(values, joint, description):
        yield _of_unit(f"{large} of {joint} spans {np.nanmax(values) - np.nanmin(values):.3g} rad, "
                       f"{max(std) / min(std):.0f} times the other: probably {large} is in "
                       "deg", joint, large, UNIT, "deg")  # fmt: skip


def _outside(values: np.ndarray, joint: str, description: Description) -> bool:
    """True for angles far outside the joint limits, or of several turns if it has none."""
    low, high = description.limits(joint)
    if not np.isfinite(high - low):
        low, high = -2.0 * np.pi, 2.0 * np.pi
    margin = 0.5 * (high - low) + 0.5
    return bool(np.nanmax(values) > high + margin or np.nanmin(values) < low - margin)


def _limits(
    record: Record, joint: str, turning: bool, description: Description
) -> Iterator[Finding]:
    """Compare positions with the joint limits: in degrees or mm, or off by whole turns."""
    q = _of(record, "q", joint)
    low, high = description.limits(joint)
    if q is None or not np.isfinite(high - low) or not _outside(q, joint, description):
        return
    count = round(float(np.nanmedian(q)) / TURN) if turning else 0
    if count and not _outside(q - TURN * count, joint, description):
        offset = Change(MAPPING, OFFSET, -TURN * count, "q", joint)
        text = f"q of {joint} is {count} turns beyond its limits of {low:.3g} and {high:.3g}"
        yield Finding("turns", (joint,), text, (offset,))
        return
    unit, standard = ("deg", "rad") if turning else ("mm", "m")
    spans = f"q of {joint} goes from {np.nanmin(q):.3g} to {np.nanmax(q):.3g} {standard}, its limits " \
            f"are {low:.3g} and {high:.3g}"  # fmt: skip
    if not _outside(factor(unit) * q, joint, description):
        yield _of_angles(record, joint, f"{spans}: probably q is in {unit}", UNIT, unit)
    elif turning:
        yield _of_unit(f"{spans}: a wrong unit or scale", joint)


def _torque(record: Record, robot: Robot) -> Iterator[Finding]:
    """Compare torques with the joint limit, and the measured torque with its command."""
    torque = record.command.get("torque")
    for joint in record.joints:
        tau, target = _of(record, "tau", joint), None
        if torque is not None and joint in record.driven:
            target = _motor(record, robot, joint, torque[:, record.driven.index(joint)])
        limit = robot.effort[robot.joints.index(joint)]
        limit = limit if limit > 0.0 else np.inf
        large = [] if target is None else list(_size("command_torque", joint, target, limit, 4.0))
        large += [] if tau is None else list(_size("tau", joint, tau, limit))
        yield from large
        if tau is None or target is None or large:
            continue
        terms = target, target + _spring(record, robot, joint)
        ratio, correlation = max((slope(c, tau) for c in terms), key=lambda fit: fit[1])
        if correlation > 0.9 and not 1.0 / RATIO_FAR < ratio < RATIO_FAR:
            unit = power_of_ten(ratio)
            mend = (UNIT, unit) if unit else (SCALE, float(1.0 / ratio))
            what = f"in {unit.replace(' ', '·')}" if unit else "a current in A"
            yield _of_unit(f"tau of {joint} is {ratio:.3g} times command_torque: probably {what}, "
                           "not N·m", joint, "tau", *mend)  # fmt: skip


def _motor(record: Record, robot: Robot, joint: str, commanded: np.ndarray) -> np.ndarray:
    """Torque of a motor that is told a torque, current or voltage, by its gains, (T,)."""
    drive, q = robot.drives.get(joint), _of(record, "q", joint)
    if not isinstance(drive, TorqueDrive):
        return commanded
    speed = rates(bridged(q), record.dt) if drive.slope else 0.0
    return drive.motor_torque(commanded, speed)


def _spring(record: Record, robot: Robot, joint: str) -> np.ndarray:
    """Torque of a spring beside the motor, which a torque sensor of the joint reads too, (T,)."""
    spring, q = robot.springs.get(joint), bridged(_of(record, "q", joint))
    if spring is None:
        return np.zeros(len(q))
    return spring_torques(q, rates(q, record.dt), spring.row())


def power_of_ten(ratio: float) -> str:
    """Unit of torques that are so many times those in N·m or N; empty if none is near."""
    return next((unit for unit, size in POWERS.items()
                 if abs(np.log(max(abs(ratio) * size, 1e-12))) < TENTH), "")  # fmt: skip


def _unsigned(record: Record) -> Iterator[Finding]:
    """Compare the measured torque with its cause (command or position error): lost sign.

    A joint that is loaded to one side has torques of one sign as well, but then its command or
    position error has one sign too.
    """
    kind = "torque" if "torque" in record.command else "position"
    for i, joint in enumerate(record.driven if kind in record.command else ()):
        tau, q = _of(record, "tau", joint), _of(record, "q", joint)
        if tau is None or q is None:
            continue
        requested = record.command[kind][:, i] - (q if kind == "position" else 0.0)
        both = np.isfinite(tau) & np.isfinite(requested)
        if both.sum() < 20 or np.any(tau[both] > 0.0) == np.any(tau[both] < 0.0):
            continue
        large = 0.1 * np.max(np.abs(requested[both]))
        balance = min(np.mean(requested[both] > large), np.mean(requested[both] < -large))
        signed = abs(slope(requested, tau)[1])
        size = slope(np.abs(requested), np.abs(tau))[1]
        if balance > BOTH_WAYS and size > 0.7 and size > signed + 0.3:
            what = "command_torque" if kind == "torque" else "command minus q"
            yield _of_unit(f"tau of {joint} has one sign only, and follows the size of {what} "
                           f"(correlation {size:.2f}) but not its sign ({signed:.2f}): probably "
                           "tau is unsigned", joint)  # fmt: skip


def _size(
    what: str, joint: str, values: np.ndarray, limit: float, factor: float = 1.0
) -> Iterator[Finding]:
    """Torques many times the joint limit; `factor` is an extra factor for commands."""
    magnitudes = np.abs(values[np.isfinite(values)])
    usual = float(np.percentile(magnitudes, 99.0)) if len(magnitudes) else 0.0
    if usual > 5.0 * factor * limit:
        milli = usual > 100.0 * limit
        unit = "mN·m" if milli else "A or in counts"
        text = f"{what} of {joint} reaches {usual:.4g} N·m, many times the limit of the joint: " \
               f"probably it is in {unit}, not N·m"  # fmt: skip
        yield replace(_of_unit(text, joint, what, UNIT, "mN m" if milli else ""),
                      fault="unit" if milli and what != "tau" else "effort")  # fmt: skip


def _imu(record: Record) -> Iterator[Finding]:
    gyro, acceleration = record.signals.get("gyro"), record.signals.get("acceleration")
    if gyro is not None:
        size = np.linalg.norm(gyro, axis=1)
        size = size[np.isfinite(size)]
        if len(size) and np.percentile(size, 90.0) > 35.0:
            yield _of_unit(f"gyro reaches {np.percentile(size, 90.0):.3g} rad/s: probably deg/s",
                           "", "gyro", UNIT, "deg/s")  # fmt: skip
    if acceleration is not None:
        size = np.linalg.norm(acceleration, axis=1)
        size = size[np.isfinite(size)]
        usual = float(np.median(size)) if len(size) else 9.8
        for low, high, unit in ((0.75, 1.3, "g"), (750.0, 1300.0, "mg")):
            if low < usual < high:
                text = f"acceleration is {usual:.3g} m/s² most of the time: probably {unit}"
                yield _of_unit(text, "", "acceleration", UNIT, unit)
    for role in ("orientation", "base_orientation"):
        q = record.signals.get(role)
        if q is not None and np.nanmedian(np.abs(q[:, 0])) > 0.9:
            yield _of_unit(f"{role} has its largest part in x, a robot on its back: probably the "
                           "order is w, x, y, z")  # fmt: skip


def _inputs(record: Record) -> Iterator[Finding]:
    supply, enable = record.inputs.get("supply"), record.inputs.get("enable")
    usual = 1.0 if supply is None else float(np.median(supply))
    if not 0.3 <= usual <= 2.5:
        yield _of_unit(f"supply is {usual:.3g} most of the time, not near 1: probably in V, to be "
                       "divided by the nominal voltage (unit: V, scale: 1/12)")  # fmt: skip
    if enable is not None and not np.all((enable == 0.0) | (enable == 1.0)):
        yield _of_unit(f"enable must be 0 or 1, it has {np.min(enable):g} to {np.max(enable):g}")
