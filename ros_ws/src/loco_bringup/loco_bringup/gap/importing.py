# SPDX-License-Identifier: Apache-2.0
"""Read recordings for `loco gap`: loco bags, bags of standard messages, tables with a mapping."""

from __future__ import annotations

import contextlib
import re
import shutil
import xml.etree.ElementTree as ET
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import yaml

from loco_control.exceptions import (
    BagError,
    LocoError,
    MissingFileError,
    NameUnknownError,
    ParameterError,
)
from loco_control.files import write_whole
from loco_control.reading import understood
from loco_learning.gap.importing import align, importing, tables
from loco_learning.gap.recordings import mapping, tracks
from loco_learning.gap.recordings.mapping import Mapping
from loco_learning.gap.recordings.record import Doubt, Record
from loco_learning.gap.recordings.tracks import Track
from loco_sim import lazy
from loco_sim.foreign.read import stem
from loco_sim.foreign.tidy import Tidied
from loco_sim.plant import model as models
from loco_sim.robot import robot as robots
from loco_sim.robot.description import Description
from loco_sim.robot.robot import Robot

from ..bag.foreign.opening import BAG_TYPES, name_of, open_bag, suffix_of
from ..bag.reader import Bag
from ..outcome import STEP
from . import topics as gap_topics
from .drafts.terminal import FORMATS, draft, joints_of
from .fields import FieldSource

_new_robot = lazy.module("loco_bringup.robot.terminal")
_HOLDING_KEYS = ("fixed_base", "height")  # keys of an experiment about how the robot was held
# Travel of a joint over the largest one, or over 1 rad beside a wheel, from which on it moves (taste).
MOVES = 0.05
# Drafts of a robot and of a mapping in a folder of results.
DRAFTS = ROBOT, MAPPING = "drafts/robot/robot.yaml", f"drafts/{mapping.FILE}"


def drafted(
    robot: str, bags: Sequence[str], mapping_file: str, folder: Path
) -> tuple[str, str, tuple[str, ...]]:
    """Robot and mapping of a search; those that the user has not written are drafted.

    A draft that is there already is used, since the user may have corrected it.

    Args:
        robot: Robot, ``robot.yaml`` or ``model.yaml``; a URDF, xacro or MJCF gets a draft.
        bags: Recordings. Tables and bags of other topics get a draft if none has a mapping.
        mapping_file: Path of a mapping; empty for none.
        folder: Folder of the results.

    Returns:
        Robot, mapping (empty for none), and a sentence on each draft.

    Raises:
        LocoError: A draft cannot be made; no new draft of a robot remains.
    """
    draft_file = folder / ROBOT
    is_new = Path(robot).suffix in FORMATS and not draft_file.is_file()
    try:
        return _drafted(robot, bags, mapping_file, folder, is_new)
    except LocoError:
        if is_new:  # it does not fit the log yet, and would be taken for one that was corrected
            shutil.rmtree(draft_file.parent, ignore_errors=True)
            with contextlib.suppress(OSError):  # they hold something, or are not there
                draft_file.parent.parent.rmdir()
                folder.rmdir()
        raise


def _drafted(
    robot: str, bags: Sequence[str], mapping_file: str, folder: Path, is_new: bool
) -> tuple[str, str, tuple[str, ...]]:
    source, draft_file, notes = Path(robot), folder / ROBOT, []
    is_drafted = source.suffix in FORMATS
    if is_new:
        _new_robot.tried(source, draft_file.parent)
    elif is_drafted:
        notes += _outdated(source, draft_file)
    robot = str(draft_file.parent) if is_drafted else robot
    if not mapping_file and all(_is_undescribed(Path(path)) for path in bags):
        mapping_file = str(folder / MAPPING)
        if not Path(mapping_file).exists():
            joints = joints_of(models.load_any(robot).make_robot())
            joints = replace(joints, passive=_without_effort(source)) if is_drafted else joints
            write_whole(Path(mapping_file), draft(bags[0], joints))
        what = "; ".join(
            f"{c.column} is {c.role} of {c.place}" + f" [{c.unit}]" * bool(c.unit)
            for c in mapping.load(mapping_file).columns
        )
        notes.append(Doubt(f"{mapping_file} is a draft, to be corrected: {what}"))
    rules = mapping_of(Path(bags[0]), mapping_file or None) if is_new else None
    if rules:
        text = _fitting(draft_file.read_text(encoding="utf-8"), rules, robot)
        write_whole(draft_file, text)
        _leave_passive(draft_file, rules, bags)
    if is_drafted:
        description = draft_file.with_name(f"{stem(source)}.urdf")
        notes = [*map(Doubt, Tidied(description).suspects), *notes]  # they explain all that follows
        keys = re.findall(r"^(\w+):.*# guessed", draft_file.read_text(encoding="utf-8"), re.M)
        notes.append(Doubt(f"{draft_file} is a draft, to be corrected; guessed: {', '.join(keys)}"))
    return robot, mapping_file, tuple(notes)


def _outdated(source: Path, draft_file: Path) -> list[Doubt]:
    """Note that a description is newer than its draft.

    Raises:
        ParameterError: The draft was made from another description.
    """
    match = re.search(r"^urdf: (\S+)$", draft_file.read_text(encoding="utf-8"), re.M)
    used = draft_file.parent / (match[1] if match else source.name)
    if stem(used) != stem(source):
        raise ParameterError(
            f"{draft_file} was drafted from {used.name}, not from {source.name}: "
            f"name another --out, or remove {draft_file.parent}"
        )
    if not used.is_file() or source.stat().st_mtime <= used.stat().st_mtime:
        return []
    advice = f"remove {draft_file.parent} for a new draft"
    return [Doubt(f"{source} was changed after the draft {used}, which is used: {advice}")]


def _fitting(text: str, rules: Mapping, robot: str) -> str:
    """A drafted ``robot.yaml`` for a log: driven by torques if it has no other commands.

    Joints without any column, such as the fingers of an arm, are locked where they stand.
    """
    roles = {*(column.role for column in rules.columns), *["command_torque"] * bool(rules.undriven)}
    if "command_torque" in roles and "command_position" not in roles:
        text = text.replace("[control_rate, drives]", "[control_rate]")
        text = re.sub(r"kind: impedance, [^}]*", "kind: torque", text)
    model = models.load_any(robot).make_robot()
    mapped = {c.place for c in rules.columns} | {*rules.locked} | {m.other for m in rules.mend}
    mapped |= {joint for joint, coupling in model.followers.items() if coupling[0] in mapped}
    positions = zip(model.joints, model.standing, strict=True)
    locked = {joint: float(q) for joint, q in positions if joint not in mapped}
    if not locked or len(locked) == len(model.joints) or model.legs is not None:
        return text
    line = yaml.safe_dump({robots.LOCKED: locked}, default_flow_style=True, width=1e6)[1:-2]
    return f"{text.rstrip()}\n{line}  # guessed, as the log has no column of them\n"


def _without_effort(source: Path) -> list[str]:
    """Joints without an effort limit above 0 where others have one: they have no drive."""
    efforts = Description(ET.tostring(Tidied(source).root, "unicode")).efforts()
    limited = {joint for joint, effort in efforts.items() if 0.0 < effort < np.inf}
    return [joint for joint in efforts if joint not in limited] if limited else []


def _leave_passive(draft_file: Path, rules: Mapping, bags: Sequence[str]) -> None:
    """Leave out guessed drives of joints that move in recordings without any command of them.

    If one moves in none, all keep their drives: the recordings are then refused, with what is
    missing.
    """
    robot = models.load_any(str(draft_file.parent)).make_robot()
    commanded = {c.place for c in rules.columns if c.role.startswith("command_")}
    read = {c.place for c in rules.columns if c.role == "q"}
    passive = [joint for joint in robot.drives if joint in read - commanded]
    if robot.legs is not None or not passive or not commanded & {*robot.drives}:
        return
    drafted = draft_file.read_text(encoding="utf-8")
    lines = "|".join(map(re.escape, passive))
    text = re.sub(rf'^  "?({lines})"?: \{{kind: .*\n', "", drafted, flags=re.MULTILINE)
    text += f"# no drive, as they move without a command: {', '.join(passive)}\n"
    write_whole(draft_file, text)
    robot = models.load_any(str(draft_file.parent)).make_robot()
    travel = np.zeros(len(robot.joints))
    for bag in bags:
        with contextlib.suppress(LocoError):  # it is refused with the reason when it is read
            q = load(Path(bag), robot, rules.path, judge=False)[0].joints_of(robot, "q")
            travel = np.fmax(travel, np.nanmax(q, axis=0) - np.nanmin(q, axis=0))
    if min(travel[robot.joints.index(joint)] for joint in passive) < MOVES * min(travel.max(), 1.0):
        write_whole(draft_file, drafted)


def _is_undescribed(path: Path) -> bool:
    """Whether a recording has no mapping and needs one: tables, or a bag of other topics."""
    if not path.exists() or mapping_of(path, None):
        return False
    if suffix_of(path):
        return not gap_topics.is_known(open_bag(path))
    return any(map(tables.is_table, path.iterdir() if path.is_dir() else [path]))


@understood("whole recording")
def load(
    path: str | Path, robot: Robot, mapping_file: str | Path | None = None, judge: bool = True
) -> list[Record]:
    """Records of a bag, a table, or a folder of tables.

    Args:
        path: Bag folder, file of a bag (MCAP, SQLite, ROS 1), table (`tables.KINDS`), or a folder
            of tables.
        robot: Robot that was measured.
        mapping_file: ``mapping.yaml``, or the folder with it; default the one beside the
            recording. A bag with the topics of loco needs none.
        judge: Refuse signals that are probably in a wrong unit; else `setup.family` reports them.

    Raises:
        MissingFileError: There is no recording, or a table has no mapping.
        LocoError: The recording contradicts its mapping or robot.
    """
    path = Path(path)
    if not path.exists():
        raise MissingFileError(importing.NO_RECORDING.format(path))
    rules = mapping_of(path, mapping_file)
    if suffix_of(path):
        return _from_bag(open_bag(path), name_of(path), robot, rules, judge)
    if path.is_file() and not tables.is_table(path):
        echoed = path.suffix in (".yaml", ".yml")
        hint = "; a file of `ros2 topic echo` needs the ending .txt" if echoed else ""
        raise ParameterError(
            f"{path.name} is no recording: wanted are {', '.join(BAG_TYPES)}, "
            f"{', '.join(tables.SUFFIXES)}, and .gz of texts{hint}"
        )
    if rules is None:
        raise MissingFileError(
            f"{path} needs a mapping that says what its columns are (--mapping, or a "
            f"{mapping.FILE} beside it); `loco gap mapping {path}` drafts one"
        )
    try:
        return importing.load(path, robot, rules, judge)
    except NameUnknownError as error:  # as of a draft that was made for other recordings
        raise ParameterError(f"{error}; {rules.path} names it") from None


def mapping_of(path: Path, file: str | Path | None) -> Mapping | None:
    """Mapping of a recording: `file`, or the one beside the recording; None if there is none."""
    if file is not None:
        return mapping.load(file)
    default = (path if path.is_dir() else path.parent) / mapping.FILE
    return mapping.load(default) if default.is_file() else None


def _from_bag(
    bag: Bag, name: str, robot: Robot, rules: Mapping | None, judge: bool
) -> list[Record]:
    rules = rules or Mapping(bag.path)
    if rules.columns:
        topics = (column.topic for column in rules.columns if not column.clock)
        source = FieldSource(bag, name, topics)
        return importing.records(source, robot, rules, bag.path.name, judge)
    signals, notes = gap_topics.read(bag, robot, rules.namespace, rules.base_pose)
    signals = tracks.without(signals, rules.missing, notes)
    settings = _experiment(bag) | rules.overrides
    step = _simulated(bag)
    matching = [r for r in rules.records if importing.fits(r, bag.path.name, {})]
    if not matching:
        raise BagError(f"no record of {rules.path} fits {bag.path.name}; see its 'records'")
    result: list[Record] = []
    for i, rule in enumerate(matching):
        first, *later = align.records(
            rule.name or (f"{name} {i + 1}" if len(matching) > 1 else name),
            [_cut(track, rule) for track in signals],
            robot,
            rate=rules.rate,
            role=rule.role,
            overrides=settings | rule.overrides,
            notes=notes,
            trust_units=rules.trust_units,
            simulated=step,
            joint_torque=step > 0.0,
            mend=rules.mend,
            judge=judge,
        )
        result += [first.rested(-rule.rest), *later]  # after a cut, the robot was not at rest
    return result


def _cut(track: Track, rule: mapping.Rule) -> Track:
    """Part of a track within the times of a rule."""
    if rule.rows != (None, None):
        raise ParameterError(f"records of a bag are cut by from and to, not by rows {rule.rows}")
    inside = (track.t >= rule.start) & (track.t <= rule.end)
    return replace(track, t=track.t[inside], x=track.x[inside])


def _experiment(bag: Bag) -> dict:
    """Values of the experiment about how the robot was held; empty if it is no loco run."""
    if "experiment.yaml" not in bag.attachments():
        return {}
    values = bag.yaml("experiment.yaml")
    overrides = values.get("overrides") if isinstance(values, dict) else None
    return {key: overrides[key] for key in _HOLDING_KEYS if key in (overrides or {})}


def _simulated(bag: Bag) -> float:
    """Physics step of the recorded simulation [s]; 0 for a real robot or if unknown."""
    about = bag.metadata
    try:
        step = 0.0 if "hardware" in about else float(about.get(STEP, 0.0))
    except ValueError:
        return 0.0
    return step if 0.0 < step < 1.0 else 0.0
