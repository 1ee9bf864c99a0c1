# SPDX-License-Identifier: Apache-2.0
"""Short simulations of the initial model along recordings, with corrections of the set-up.

Every suspected mistake is tested in the same way: by how much the correcting line lowers the
error of the model.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from loco_control.exceptions import LocoError
from loco_sim.bolted.loop import needs_engine
from loco_sim.plant.model import Model

from ..prediction import running
from ..prediction.forward import Forward, ForwardParams
from ..prediction.led import InverseDynamics, possible
from ..recordings import lags
from ..recordings.record import Record, bridged
from .finding import EFFECTS, MODEL, Change, Finding, composed, correct
from .limits import LIMITS

SECONDS, COUNT = 5.0, 2  # simulated part of a record, and number of records (taste: 0.1 s each)
MAX_ERROR = 3.0  # bound on the error of a joint, over the standard deviation of its signal


@dataclass(frozen=True)
class Trial:
    """A simulation of the model.

    Attributes:
        joints: Joints of the columns.
        said: Simulated joint positions, or torques along the measured motion, per record.
        measured: Measured positions or torques, per record.
        moving: Whether a motion tells anything, see `moving`, per record (n,); empty for always.
    """

    joints: tuple[str, ...]
    said: tuple[np.ndarray, ...]
    measured: tuple[np.ndarray, ...]
    moving: tuple[np.ndarray, ...] = ()

    def each(self) -> list[tuple[np.ndarray, np.ndarray, np.ndarray]]:
        """Simulated, measured, and whether the motion of a joint tells anything, per record."""
        moving = self.moving or [np.ones(len(self.joints), dtype=bool)] * len(self.said)
        return list(zip(self.said, self.measured, moving, strict=True))

    def misses(self) -> np.ndarray:
        """Rms error of each joint over the deviation of its signal, (n,), up to `MAX_ERROR`.

        It is 0 for a joint that is held.
        """
        square, size = np.zeros(len(self.joints)), np.zeros(len(self.joints))
        for errors, valid in self._errors():
            square += np.minimum(np.sum(errors**2, axis=0), MAX_ERROR**2 * len(errors))
            size += valid.sum(axis=0)
        return np.minimum(np.sqrt(square / np.maximum(size, 1.0)), MAX_ERROR)

    def errors(self) -> np.ndarray:
        """Errors of all joints over the deviation of their signals, (N,), up to `MAX_ERROR`."""
        errors = [each[valid] for each, valid in self._errors()]
        return np.clip(np.concatenate(errors), -MAX_ERROR, MAX_ERROR)

    def _errors(self) -> Iterator[tuple[np.ndarray, np.ndarray]]:
        """Errors over the deviation of each signal, and flags of those that count, per record."""
        for sim, measured, moving in self.each():
            valid = np.isfinite(measured) & moving
            errors = np.where(valid, np.where(np.isfinite(sim), sim - measured, np.inf), 0.0)
            count = np.maximum(valid.sum(axis=0), 1)
            mean = np.where(valid, measured, 0.0).sum(axis=0) / count
            variance = np.where(valid, (measured - mean) ** 2, 0.0).sum(axis=0) / count
            yield errors / np.sqrt(np.maximum(variance, 1e-12)), valid

    def miss(self, joints: Sequence[str] = ()) -> float:
        """Rms of `misses` over some joints, or over all if none is named, without held ones."""
        moving = np.any([each for _, _, each in self.each()], axis=0)
        indices = [i for i, joint in enumerate(self.joints)
                if moving[i] and (not joints or joint in joints)]  # fmt: skip
        return float(np.sqrt(np.mean(self.misses()[indices] ** 2))) if indices else 0.0


class Bench:
    """Simulations of a model along a few seconds of recordings, with changes of the set-up.

    A robot that needs an engine is not simulated: its commands, delayed as the motion is, replace
    the simulation.

    Attributes:
        model: Robot, overrides and effects.
        records: Simulated parts of recordings.
        led: Whether torques are compared (inverse dynamics), not positions.
    """

    def __init__(self, model: Model, records: Sequence[Record], changes: Sequence[Change] = ()):
        """Choose the parts to simulate.

        Args:
            model: Robot, overrides and effects.
            records: Recordings; the first two that need no engine are simulated.
            changes: Changes of the set-up that are always applied.
        """
        self.model, self._all, self._changes = model, tuple(records), tuple(changes)
        engine = [bool(needs_engine(model.make_robot(record.overrides))) for record in records]
        selected = [r for r, e in zip(records, engine, strict=True) if not e] or list(records)
        self.free, self.led = all(engine), False
        self.robot = (
            model_with(model, changes).make_robot(selected[0].overrides) if records else None
        )
        self.records = [busiest(record, SECONDS) for record in selected[:COUNT]]
        self._trials: dict[str, Trial | None] = {}
        self._without_tau = False
        self._robots: dict[Any, Any] = {}
        self.possible = bool(self.records) and self() is not None and bool(self().joints)
        if self.possible and running.integral_limits(self.robot).any():
            self._choose_integrators()

    def _choose_integrators(self) -> None:
        """Begin integrators by measured torques only if the model does not fit better without.

        A current whose torque constant is not known would make another unit of the motion likely.
        """
        if not any(record.has("tau") for record in self.records):
            return
        by_torques, trials = self.miss(), self._trials
        self._without_tau, self._trials = True, {}
        if not self.miss() < by_torques:
            self._without_tau, self._trials = False, trials

    def mended(self, changes: Iterable[Change]) -> Bench:
        """Copy with more changes of the set-up; itself if there are none."""
        changes = tuple(changes)
        total = composed([*self._changes, *changes])
        return Bench(self.model, self._all, total) if changes else self

    def __call__(self, *changes: Change) -> Trial | None:
        """Simulation with changes; None if the model cannot be simulated with them."""
        key = repr(changes)
        if key not in self._trials:
            try:
                self._trials[key] = self._run(composed([*self._changes, *changes]))
            except (LocoError, ValueError, np.linalg.LinAlgError):
                self._trials[key] = None
        return self._trials[key]

    def miss(self, *changes: Change) -> float:
        """Error of all joints with changes; infinite if the model cannot be simulated with them."""
        trial = self(*changes)
        return np.inf if trial is None else trial.miss()

    @property
    def fits(self) -> bool:
        """True if the model fits the recordings as well as a set-up without mistakes does."""
        return self().miss() < LIMITS.missed

    def whole(self) -> tuple[Model, list[Record]]:
        """The model, and the complete recordings as imported, with the changes so far."""
        records = [correct(record, self._changes) for record in self._all]
        return model_with(self.model, self._changes), records

    def told_records(self) -> list[Record]:
        """The parts of recordings as imported with the changes so far."""
        return [correct(record, self._changes) for record in self.records]

    def told(self) -> Trial:
        """Commanded positions in place of a simulation."""
        return commanded(self.told_records())

    def torques(self, *changes: Change) -> Trial | None:
        """Simulation with changes, compared in measured joint torques; None if there were none.

        If torques are commanded, these take the place of a simulation.
        """
        trial, total = self(*changes), composed([*self._changes, *changes])
        records = [correct(record, total) for record in self.records]
        if not (trial and trial.joints and records) or not all(r.has("tau") for r in records):
            return None
        if self.led:
            names = trial.joints
            commands = [r.command["torque"][:, [r.driven.index(j) for j in names]] for r in records]
            tau = [r.signals["tau"][:, [r.joints.index(j) for j in names]] for r in records]
            return Trial(names, tuple(commands), tuple(tau))
        forward = self._forward(Forward, total, records, "tau")
        names = tuple(channel.name for channel in forward.channels)
        return Trial(names, tuple(forward()), tuple(forward.measured))

    def drive_torques(self) -> dict[str, float]:
        """Largest torque that the model asks of the drive of each moving joint [N·m or N]."""
        torque, _ = self._forward(Forward, self._changes, self.told_records(), "q").drives()
        joints, largest = self.robot.joints, np.abs(torque).max(axis=0)
        sizes = {joint: float(largest[joints.index(joint)]) for joint in self().joints}
        return {joint: size for joint, size in sizes.items() if 0.0 < size < np.inf}

    def supported(self, options: Sequence[tuple[Change, ...]]) -> list[tuple[Change, ...]]:
        """Of sets of lines those with which the model explains the measured torques best.

        All of them if no torque was measured, or if it is not explained with any of them.
        """
        if self.free or not all(record.has("tau") for record in self.records):
            return list(options)
        runs = [self.torques(*one) for one in options]
        errors = [run.miss() if run else np.inf for run in runs]
        smallest = min(errors, default=np.inf)
        limit = LIMITS.alike * smallest + 1e-3 if smallest < LIMITS.explained else np.inf
        return [option for option, error in zip(options, errors, strict=True) if error <= limit]

    def settled(
        self,
        fault: str,
        joints: tuple[str, ...],
        note: str,
        fixes: Iterable[tuple[Change, ...]],
        total: bool = False,
    ) -> list[Finding]:
        """A finding if one of several sets of lines corrects a suspected mistake; otherwise empty.

        Args:
            fault: Kind of mistake.
            joints: Joints with the mistake; empty for the whole robot.
            note: The mistake in one sentence, with numbers.
            fixes: Sets of lines that may correct it.
            total: Whether the error of all joints decides.
        """
        scored = () if total else joints
        before = self().miss(scored)
        trials = [(self(*fix), fix) for fix in fixes if fix]
        after = sorted((t.miss(scored), k) for k, (t, _) in enumerate(trials) if t)
        if not after or after[0][0] >= min(before / LIMITS.better, LIMITS.left):
            return []
        best = after[0][0]
        fixes = self.supported([trials[k][1] for miss, k in after
                               if miss < LIMITS.alike * best + 1e-3])  # fmt: skip
        text = f"{note}. The model misses {before:.0%} of it as it is, {best:.0%} with this mended"
        return [Finding(fault, joints, text, fixes[0], tuple(fixes[1:]))]

    def _run(self, changes: Sequence[Change]) -> Trial:
        records = [correct(record, changes) for record in self.records]
        if self.free:
            return commanded(records)
        if not self.led:
            parts = (
                [_without_torques(record) for record in records] if self._without_tau else records
            )
            forward = self._forward(Forward, changes, parts, "q")
            self.led = possible(forward) and not forward.robot().springs  # springs restore joints
        if self.led:
            forward = self._forward(InverseDynamics, changes, records, "tau")
        names = tuple(channel.name for channel in forward.channels)
        moves = tuple(moving(record, names) for record in records)
        return Trial(names, tuple(forward()), tuple(forward.measured), moves)

    def _forward(
        self, kind: type[Forward], changes: Sequence[Change], records: Sequence[Record], signal: str
    ) -> Forward:
        """Forward model with changes of the set-up; robots that were loaded once are kept."""
        model, params = model_with(self.model, changes), ForwardParams(signals=(signal,))
        return kind(model, records, params, self._robots)


def _without_torques(record: Record) -> Record:
    """The recording without measured torques."""
    return replace(record, signals={k: v for k, v in record.signals.items() if k != "tau"})


def moving(record: Record, joints: Sequence[str]) -> np.ndarray:
    """Whether a simulation of each joint can show mistakes in its columns, (n,).

    It cannot for a joint that is held, which only noise, friction and coupling move.
    """
    commands = [record.command[kind] for kind in ("position", "velocity") if kind in record.command]
    moves = np.zeros(len(joints), dtype=bool)
    for i, joint in enumerate(joints):
        if joint not in record.joints or lags.is_held(
            record.signals["q"][:, record.joints.index(joint)]
        ):
            continue
        driven = commands if joint in record.driven else []
        courses = [command[:, record.driven.index(joint)] for command in driven]
        moves[i] = not courses or not all(map(lags.is_constant, courses))
    return moves


def commanded(records: Sequence[Record]) -> Trial:
    """Commanded positions, delayed as the motion is, in place of a simulation."""
    used = [r for r in records if "position" in r.command]
    joints = tuple(j for j in used[0].driven if j in used[0].joints) if used else ()
    commands, measured = [], []
    for record in used:
        command = record.command["position"][:, [record.driven.index(j) for j in joints]]
        q = record.signals["q"][:, [record.joints.index(j) for j in joints]]
        late = [lags.lag(c, bridged(x), record.dt)[0] for c, x in zip(command.T, q.T, strict=True)]
        shift = max(0, round(float(np.median(late)) / record.dt))
        commands.append(np.concatenate([np.repeat(command[:1], shift, axis=0), command])[: len(q)])
        measured.append(q)
    return Trial(joints, tuple(commands), tuple(measured), tuple(moving(r, joints) for r in used))


def model_with(model: Model, changes: Sequence[Change]) -> Model:
    """The model with those changes that concern it."""
    model_changes = [c for c in changes if c.file == MODEL]
    values = {c.key: c.value for c in model_changes if c.key != EFFECTS}
    added = [spec for c in model_changes if c.key == EFFECTS for spec in c.value]
    return replace(model, overrides={**model.overrides, **values}, effects=[*model.effects, *added])


def busiest(record: Record, seconds: float) -> Record:
    """The part of a recording, of at most `seconds`, with the most joint motion."""
    width = round(seconds / record.dt)
    if width >= len(record.t) - 1:
        return record
    rates = np.diff(bridged(record.signals["q"]), axis=0)
    size = np.maximum(np.sqrt(np.mean(rates**2, axis=0)), 1e-12)
    energy = np.concatenate([[0.0], np.cumsum(np.mean((rates / size) ** 2, axis=1))])
    first = int(np.argmax(energy[width:] - energy[:-width]))
    return record.rows(first, first + width + 1)
