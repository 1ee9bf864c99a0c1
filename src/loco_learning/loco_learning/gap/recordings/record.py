# SPDX-License-Identifier: Apache-2.0
"""Record: the measurement of a robot in one experiment, on one even time axis."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from loco_control.exceptions import NameUnknownError, ParameterError
from loco_sim.robot.robot import Robot

from ...reflex.joint_sensors import columns

COMMANDS = ("position", "velocity", "torque")
JOINT_SIGNALS = ("q", "dq", "tau")
WIDTHS = {"gyro": 3, "acceleration": 3, "base_position": 3, "orientation": 4, "base_orientation": 4}
FEET_SIGNAL = "grf"
INPUTS = ("supply", "enable")
FIT, HELD_OUT = "fit", "held-out"


class Doubt(str):
    """Import note on a condition that can itself look like a gap, to be resolved first."""


@dataclass(frozen=True, eq=False)
class Record:
    """Commands and measured signals of one experiment.

    Attributes:
        name: Name of its source, for messages.
        t: Times [s], evenly spaced from 0, (T,).
        command: Per kind of `COMMANDS` the command from each time on, (T, m), in rad, rad/s
            and N·m (m, m/s and N on a prismatic joint).
        driven: Joints of the command's columns.
        signals: Measured values; NaN where not measured. Joint signals `q` [rad], `dq` [rad/s]
            and `tau` [N·m], (T, n); `gyro` [rad/s], `acceleration` [m/s²] and `base_position`
            [m], (T, 3); `orientation` (IMU) and `base_orientation`, (T, 4) xyzw; `grf`
            [N], (T, feet).
        joints: Joints of the columns of the joint signals.
        feet: Feet of the columns of `grf`.
        inputs: `supply`, voltage over its nominal value, and `enable`, 0 or 1, each (T,).
        stance: Stance of each foot, (T,): 1 while its leg uses the stance gains and 0 while it
            uses the swing gains; a foot that is not listed always stands.
        overrides: Known values of robot.yaml for this record, e.g. the drive's gain in the run.
        notes: Notes of import and alignment, a sentence each; those on conditions that can look
            like a gap are of type `Doubt`.
        resolution: Quantisation step per signal and joint (or axis) [unit of the signal]; 0 if
            none was detected, left out if the signal hardly changes.
        role: `FIT`, or `HELD_OUT` for a record that is not fitted.
        warnings: Reasons against using the record, a sentence each.
        ramps: Kinds of command that are linear between samples; others are held.
        stamps: Per role, as recorded: rate [Hz], jitter (standard deviation of the time stamps
            from even ones) [ms], number of missing samples, and longest silence [s].
        simulated: Physics step of the recorded simulation [s]; 0 for a real robot or if unknown.
        stepped: The same of another simulator, whose torques are those of an instant.
        joint_torque: Whether measured torques are those of all that acts in a joint, as in
            simulations of loco: of drive, springs and effects. Otherwise of the drive alone.
        unsure: Per kind of command, estimated error of an undersampled one, (T, m), in its unit;
            left out if all samples are known.
        guessed: Flags of values of joint signals that were not measured, as `signals`:
            interpolated lost readings, and an assumed rest before the record. They serve as
            initial states, but are not compared.
        moved: Per joint signal the time by which its readings were moved from their time stamps to
            `t` [s], as `signals`; left out if none was.
        late: Largest time by which stamps of positions were put back to an even clock [s].
        unscaled: Joints whose measured torques are currents of unknown torque constant.
        trusted: Whether the user has confirmed all units.
    """

    name: str
    t: np.ndarray
    command: dict[str, np.ndarray]
    driven: tuple[str, ...]
    signals: dict[str, np.ndarray]
    joints: tuple[str, ...]
    feet: tuple[str, ...] = ()
    inputs: dict[str, np.ndarray] = field(default_factory=dict)
    stance: dict[str, np.ndarray] = field(default_factory=dict)
    overrides: dict[str, Any] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    resolution: dict[tuple[str, str], float] = field(default_factory=dict)
    role: str = FIT
    ramps: tuple[str, ...] = ()
    warnings: tuple[str, ...] = ()
    stamps: dict[str, dict[str, float]] = field(default_factory=dict)
    simulated: float = 0.0
    stepped: float = 0.0
    joint_torque: bool = False
    unsure: dict[str, np.ndarray] = field(default_factory=dict)
    guessed: dict[str, np.ndarray] = field(default_factory=dict)
    moved: dict[str, np.ndarray] = field(default_factory=dict)
    late: float = 0.0
    unscaled: tuple[str, ...] = ()
    trusted: bool = False

    def __post_init__(self) -> None:
        _check_axis(self.name, self.t)
        count = len(self.t)
        _check_names(self.name, "command", self.command, COMMANDS)
        _check_names(self.name, "signal", self.signals, (*JOINT_SIGNALS, *WIDTHS, FEET_SIGNAL))
        _check_names(self.name, "input", self.inputs, INPUTS)
        _check_names(self.name, "role", (self.role,), (FIT, HELD_OUT))
        _check_names(self.name, "ramp", self.ramps, tuple(self.command))
        for kind, values in self.command.items():
            _shape(self.name, f"command {kind}", values, (count, len(self.driven)))
        for signal, values in self.signals.items():
            _shape(self.name, signal, values, (count, self._width(signal)))
        for kind, values in self.inputs.items():
            _shape(self.name, f"input {kind}", values, (count,))
        for foot, values in self.stance.items():
            _shape(self.name, f"stance of {foot}", values, (count,))

    def step(self, signal: str) -> float:
        """Largest quantisation step of a signal."""
        return max((step for (of, _), step in self.resolution.items() if of == signal), default=0.0)

    def step_of(self, signal: str, name: str) -> float:
        """Quantisation step of a channel; the largest of its signal if it is unknown."""
        return self.resolution.get((signal, name), self.step(signal))

    def _width(self, signal: str) -> int:
        if signal in JOINT_SIGNALS:
            return len(self.joints)
        return len(self.feet) if signal == FEET_SIGNAL else WIDTHS[signal]

    @property
    def dt(self) -> float:
        """Time between samples [s]."""
        return float(self.t[-1] - self.t[0]) / (len(self.t) - 1)

    @property
    def duration(self) -> float:
        """Time from the first to the last sample [s]."""
        return float(self.t[-1] - self.t[0])

    def has(self, signal: str) -> bool:
        """True if the signal was measured at least once."""
        return signal in self.signals and bool(np.any(np.isfinite(self.signals[signal])))

    def command_of(self, robot: Robot, kind: str) -> np.ndarray:
        """Command of the robot's driven joints, in the robot's order, (T, m).

        Raises:
            ParameterError: The record has no such command, or lacks a driven joint.
        """
        if kind not in self.command:
            raise ParameterError(
                f"{self.name} has no {kind} command; it has {', '.join(self.command) or 'none'}"
            )
        names = [robot.joints[i] for i in robot.driven]
        return self.command[kind][:, columns(self.name, names, self.driven, "commands", robot)]

    def read_of(self, robot: Robot, signal: str) -> np.ndarray:
        """As `joints_of`, with NaN also for values that are interpolated or assumed."""
        if signal not in self.guessed:
            return self.joints_of(robot, signal)
        read = np.where(self.guessed[signal], np.nan, self.signals[signal])
        return replace(self, signals={signal: read}).joints_of(robot, signal)

    def joints_of(self, robot: Robot, signal: str) -> np.ndarray:
        """A joint signal in the order of the robot's joints, (T, n); NaN where not measured."""
        values = np.full((len(self.t), len(robot.joints)), np.nan)
        if signal in self.signals:
            for column, joint in enumerate(robot.joints):
                if joint in self.joints:
                    values[:, column] = self.signals[signal][:, self.joints.index(joint)]
        return values

    def feet_of(self, feet: Sequence[str]) -> np.ndarray:
        """Ground forces in the order of `feet` [N], (T, feet); NaN where not measured."""
        values = np.full((len(self.t), len(feet)), np.nan)
        for column, foot in enumerate(feet):
            if foot in self.feet and FEET_SIGNAL in self.signals:
                values[:, column] = self.signals[FEET_SIGNAL][:, self.feet.index(foot)]
        return values

    def stance_of(self, feet: Sequence[str]) -> np.ndarray:
        """Flags of commanded stance in the order of `feet`, (T, feet) bool."""
        default = np.ones(len(self.t))
        flags = [self.stance.get(foot, default) > 0.5 for foot in feet]
        return np.array(flags, dtype=bool).reshape(len(feet), len(self.t)).T

    def rows(self, first: int, stop: int, name: str | None = None) -> Record:
        """Samples `first` to `stop` (excluded); time starts at 0 again.

        Raises:
            ParameterError: Fewer than two samples are left.
        """
        part = slice(first, stop)
        if len(self.t[part]) < 2:
            raise ParameterError(
                f"{self.name}: rows {first} to {stop} hold no two of its {len(self.t)} samples"
            )
        return replace(
            self,
            name=self.name if name is None else name,
            t=self.t[part] - self.t[part][0],
            command={k: v[part] for k, v in self.command.items()},
            signals={k: v[part] for k, v in self.signals.items()},
            inputs={k: v[part] for k, v in self.inputs.items()},
            stance={k: v[part] for k, v in self.stance.items()},
            unsure={k: v[part] for k, v in self.unsure.items()},
            guessed={k: v[part] for k, v in self.guessed.items()},
            moved={k: v[part] for k, v in self.moved.items()},
        )

    def rested(self, seconds: float) -> Record:
        """The record with a rest before it: first command, first positions, and zero velocity.

        Every model then settles under the first command, in place of a start from the first
        samples. The rest is only simulated, not compared.

        Args:
            seconds: Length of the rest.
        """
        count = round(seconds / self.dt)
        if count <= 0:
            return self

        def before(values: np.ndarray) -> np.ndarray:
            return np.concatenate([np.repeat(values[:1], count, axis=0), values])

        signals = {k: before(v) for k, v in self.signals.items()}
        for kind, values in signals.items():
            values[:count] = 0.0 if kind == "dq" else values[count] if kind == "q" else np.nan
        guessed = {k: np.zeros(signals[k].shape, dtype=bool) for k in ("q", "dq") if k in signals}
        guessed |= {k: before(v) for k, v in self.guessed.items()}
        moved = {k: before(v) for k, v in self.moved.items()}
        for flags in guessed.values():
            flags[:count] = True
        for late in moved.values():
            late[:count] = 0.0
        return replace(
            self,
            t=self.dt * np.arange(count + len(self.t)),
            command={k: before(v) for k, v in self.command.items()},
            signals=signals,
            inputs={k: before(v) for k, v in self.inputs.items()},
            stance={k: before(v) for k, v in self.stance.items()},
            unsure={k: before(v) for k, v in self.unsure.items()},
            guessed=guessed,
            moved=moved,
        )

    def between(self, start: float, end: float, name: str | None = None) -> Record:
        """Samples from `start` to `end` [s], both included; time starts at 0 again."""
        tolerance = 1e-6 * self.dt
        first, stop = np.searchsorted(self.t, [start - tolerance, end + tolerance])
        return self.rows(int(first), int(stop), name)


def _check_axis(name: str, t: np.ndarray) -> None:
    if t.ndim != 1 or len(t) < 2:
        raise ParameterError(f"{name}: a record needs at least two samples, got {t.shape}")
    step = (t[-1] - t[0]) / (len(t) - 1)
    if abs(t[0]) > 1e-9 or not step > 0.0 or np.max(np.abs(np.diff(t) - step)) > 1e-3 * step:
        raise ParameterError(f"{name}: the times of a record start at 0 and are even")


def _check_names(name: str, what: str, names: Mapping | tuple, legal: Sequence[str]) -> None:
    for key in names:
        if key not in legal:
            raise NameUnknownError(f"{what} of a record ({name})", key, legal)


def _shape(name: str, what: str, values: np.ndarray, expected: tuple[int, ...]) -> None:
    if np.shape(values) != expected:
        raise ParameterError(f"{name}: {what} has the shape {np.shape(values)}, wanted {expected}")


def spacing(rows: np.ndarray) -> int:
    """Median distance of rows with a reading, (K,): 1, or more in a log slower than the axis."""
    return int(np.median(np.diff(rows))) if len(rows) > 1 else 1


def bridged(values: np.ndarray) -> np.ndarray:
    """Signals with missing values interpolated linearly; at the ends they are held.

    Args:
        values: A signal, (T,), or one per column, (T, k); NaN where it was not measured.

    Returns:
        The same shape; a signal that was never measured is 0.
    """
    columns = values.reshape(len(values), -1)
    rows, out = np.arange(len(values)), np.zeros(columns.shape)
    for k, column in enumerate(columns.T):
        valid = np.isfinite(column)
        if valid.any():
            out[:, k] = np.interp(rows, rows[valid], column[valid])
    return out.reshape(values.shape)


def coarsest(records: Sequence[Record], signal: str, name: str) -> float:
    """Quantisation step of a channel in some records; that of its signal if unknown."""
    resolutions = [r.resolution[signal, name] for r in records if (signal, name) in r.resolution]
    return max(resolutions or [r.step(signal) for r in records])
