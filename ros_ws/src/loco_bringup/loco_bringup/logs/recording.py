# SPDX-License-Identifier: Apache-2.0
"""Read any recording as signals of joints with their own stamps; no model of a robot is needed."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from loco_control.exceptions import BagError, MissingFileError, ParameterError
from loco_control.reading import understood
from loco_learning.gap.drafting.joints import Joints
from loco_learning.gap.drafting.text import ALSO, MOVED
from loco_learning.gap.importing import importing, tables
from loco_learning.gap.recordings import mapping
from loco_learning.gap.recordings.clocks import cuts, series
from loco_learning.gap.recordings.mapping import Column
from loco_learning.gap.recordings.tracks import COUPLED, JOINT, Source, Track, values
from loco_learning.runs.log import Log

from ..bag.foreign.opening import name_of, open_bag, suffix_of
from ..bag.reader import Bag
from ..gap.drafts.terminal import draft
from ..gap.drafts.topics import first_messages
from ..gap.fields import FieldSource
from ..gap.importing import mapping_of
from .bag_log import read_log

RUN = "experiment.yaml"  # attachment of the runs of loco
COMMAND = {"q": "command_position", "dq": "command_velocity", "tau": "command_torque"}


@dataclass(frozen=True, eq=False)
class Recording:
    """Signals of the joints of a robot.

    Attributes:
        name: Name of the recording.
        tracks: Signals of `COMMAND` by role and joint, with ascending stamps [s].
        notes: Sentences on the clocks and on what was guessed or left out.
        bag: The bag of another recorder that it was read from; None for other recordings.
    """

    name: str
    tracks: dict[tuple[str, str], Track]
    notes: list[str]
    bag: Bag | None = None

    @property
    def joints(self) -> list[str]:
        """Joints with measured positions, in their order."""
        return [joint for role, joint in self.tracks if role == "q"]

    @property
    def start(self) -> float:
        """Stamp of the first measured position [s]."""
        return min(float(self.tracks["q", joint].t[0]) for joint in self.joints)

    def error(self, joint: str, role: str = "q") -> np.ndarray:
        """Reading minus the command held at its stamp, (K,); NaN where there is no command."""
        read, goal = self.tracks[role, joint], self.tracks.get((COMMAND[role], joint))
        return read.x - (at(goal, read.t) if goal else np.nan)


def at(track: Track, t: np.ndarray) -> np.ndarray:
    """Values of a signal at some times [s], (K,); NaN before the first and after the last one.

    A command holds until the next one, and the last one for 1.5 of the longest period before it.
    Measured values are interpolated linearly.
    """
    if not track.role.startswith("command_"):
        return np.interp(t, track.t, track.x, np.nan, np.nan)
    row = np.searchsorted(track.t, t + 1e-6, side="right") - 1
    end = track.t[-1] + 1.5 * float(np.max(np.diff(track.t), initial=0.0))
    return np.where((row >= 0) & (t <= end), track.x[row.clip(0)], np.nan)


def is_foreign(path: Path) -> bool:
    """Whether there is a recording that is no run of loco.

    A run of loco has its experiment inside, or, as a live calibration, messages of its types.
    """
    if not path.exists() or not suffix_of(path):
        return path.exists()
    bag = open_bag(path)
    types = [topic.type for topic in bag.topics.values()]
    return RUN not in bag.attachments() and not any(t.startswith("loco_msgs/") for t in types)


@understood("whole recording")
def read(
    path: str | Path, mapping_file: str | Path | None = None, joints: Sequence[str] = ()
) -> Recording:
    """Signals of a run of loco, a bag of any recorder, or a table.

    Args:
        path: Folder of a bag, or file of a bag or table.
        mapping_file: Mapping of its topics or columns; default the one beside the recording,
            else a draft by their names, which a note tells.
        joints: Joints that columns of a table are named after, if they are known.

    Raises:
        MissingFileError: There is no recording.
        LocoError: It cannot be read, or has no measured positions.
    """
    path = Path(path)
    if not path.exists():
        raise MissingFileError(importing.NO_RECORDING.format(path))
    bag, notes = None, list[str]()
    if suffix_of(path):
        bag = open_bag(path)
        if RUN in bag.attachments():
            return of_log(name_of(path), read_log(bag))
    elif not path.is_file() or not tables.is_table(path):
        raise ParameterError(f"{path} is neither a bag nor a table; of a folder name one file")
    rules = mapping_of(path, mapping_file)
    if rules is None or not rules.columns:
        rules = _drafted(path, bag, joints, notes)
    if bag:
        source, names = FieldSource(bag, path.name), ()
    else:
        table = tables.read(path, rules.samples)
        source, names = importing.TableSource(path, rules, table), tuple(table.columns)
    signals = [
        track
        for column in _expanded(rules.columns, names)
        for track in _tracks(column, source, rules.trust_units)
    ]
    return replace(recording(name_of(path), signals, [*source.notes, *notes]), bag=bag)


def _drafted(
    path: Path, bag: Bag | None, joints: Sequence[str], notes: list[str]
) -> mapping.Mapping:
    """Mapping that the names suggest, with notes on it; a single joint is that of each topic.

    Torques that only an identification would take as commands are measurements here.
    """
    if bag:
        names = _joints(bag)
        joints = names if len(names) == 1 else ()
    draft_text = draft(path, Joints(joints))
    rules = mapping.loads(draft_text, mapping.FILE)
    if MOVED in draft_text:
        measured = [replace(c, role="tau") if c.role == "command_torque" else c
                    for c in rules.columns]  # fmt: skip
        rules = replace(rules, columns=tuple(measured))
    if repeated := draft_text.count(ALSO):
        notes.append(f"{repeated} further signals of the same joints are left out")
    notes.append(
        f"topics, columns and joints are guessed by their names; `loco gap mapping {path}` shows "
        "how, and --mapping corrects it"
    )
    return rules


def _joints(bag: Bag) -> list[str]:
    """Joints that messages of JointState name."""
    topics = [t.name for t in bag.topics.values() if t.type.endswith("/JointState") and t.count]
    messages = [message for name in topics for message in first_messages(bag, name)]
    return sorted({joint for message in messages for joint in message.name})


def _expanded(columns: Sequence[Column], names: Sequence[str]) -> Iterator[Column]:
    """Columns of signals of joints, with ``{joint}`` expanded by the names of a table."""
    for column in columns:
        if JOINT not in column.column:
            yield column
            continue
        pattern = re.escape(column.column).replace(re.escape(JOINT), "(.+)")
        for name in names:
            if match := re.fullmatch(pattern, name):
                yield replace(column, column=name, place=match[1])


def _tracks(column: Column, source: Source, trust: bool) -> Iterator[Track]:
    """The signal of a column without missing values; nothing for other roles than `COMMAND`."""
    if column.role not in (*COMMAND, *COMMAND.values()):
        return
    t, raw = source.series(column)
    missing = column.missing is not None and raw == column.missing
    raw = np.where(missing, np.nan, raw)
    valid = np.isfinite(t) & np.isfinite(raw)
    if valid.any():
        x = values(column, raw, trust)
        yield Track(column.role, column.place, t[valid], x[valid], column.topic or column.column)


def recording(name: str, signals: Sequence[Track], notes: Sequence[str]) -> Recording:
    """Recording of some signals, with ascending stamps.

    It ends where the clock of a signal was set back, as a note says.

    Raises:
        BagError: No position was measured.
    """
    result, messages = {}, [*notes]
    try:
        series.single(name, [track for track in signals if not cuts.cut_rows([track])])
    except ParameterError as error:  # two publishers, which is no reason to show nothing
        messages.append(str(error))
    for track in signals:
        rows = cuts.cut_rows([track])
        if rows:
            messages.append(
                f"the clock of {track.label} was set back at row {rows[0]}: later readings are "
                "left out (`loco gap check` makes a record of each part)"
            )
        t, first = np.unique(track.t[: rows[0] if rows else None], return_index=True)
        result.setdefault((track.role, track.place), replace(track, t=t, x=track.x[first]))
    measured = {joint for role, joint in result if role == "q"}
    commanded = {joint for role, joint in result if role == "command_position"}
    if not measured:
        listed = ", ".join(sorted({track.label for track in signals})) or "no signal of a joint"
        raise BagError(f"{name} has no measured positions of joints; it has {listed}")
    if strangers := sorted(commanded - measured):
        messages.append(
            f"commands of {', '.join(strangers)} belong to no measured joint: name the joints in a "
            "mapping (--mapping)"
        )
    for joint in sorted(commanded & measured):
        read, goal = (result[role, joint].t for role in ("q", "command_position"))
        if goal[0] > read[-1] or goal[-1] < read[0]:
            messages.append(
                f"angles and commands of {joint} have no time in common; in a mapping, clock: log "
                "at both takes the times of logging"
            )
    return Recording(name, result, list(dict.fromkeys(messages)))


def of_log(name: str, log: Log) -> Recording:
    """Recording of a run of loco: its measured and commanded signals at every tick."""
    plant = log.experiment.plant
    driven = [plant.joints[i] for i in plant.driven]
    columns = {"q": plant.joints, "dq": plant.joints, "tau": plant.joints,
               "command": driven, "command_dq": driven}  # fmt: skip
    roles = {"command": COUPLED[1], "command_dq": COUPLED[3]}
    signals = [
        Track(roles.get(key, key), joint, log.t[valid], column[valid], name)
        for key, names in columns.items()
        for joint, column in zip(names, log.columns[key].T, strict=True)
        if (valid := np.isfinite(column)).any()
    ]
    return recording(name, signals, ())
