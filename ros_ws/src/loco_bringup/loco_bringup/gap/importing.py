# SPDX-License-Identifier: Apache-2.0
"""Read recordings for `loco gap`: loco bags, bags of standard messages, tables with a mapping."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from loco_control.exceptions import BagError, MissingFileError, ParameterError
from loco_control.reading import understood
from loco_learning.gap.recordings import align, importing, mapping, tables, tracks
from loco_learning.gap.recordings.mapping import Mapping
from loco_learning.gap.recordings.record import Record
from loco_learning.gap.recordings.tracks import Track
from loco_sim.robot.robot import Robot

from ..bag.foreign.opening import KINDS, open_bag, suffix_of
from ..bag.reader import Bag
from ..outcome import STEP
from . import topics as gap_topics
from .fields import FieldSource

_KNOWN = ("fixed_base", "height")  # keys of an experiment about how the robot was held


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
        return _from_bag(open_bag(path), robot, rules, judge)
    if path.is_file() and not tables.is_table(path):
        raise ParameterError(
            f"{path.name} is no recording: wanted are {', '.join(KINDS)}, "
            f"{', '.join(tables.KINDS)}, and .gz of texts"
        )
    if rules is None:
        raise MissingFileError(
            f"{path} needs a mapping that says what its columns are (--mapping, or a "
            f"{mapping.FILE} beside it); `loco gap mapping {path}` drafts one"
        )
    return importing.load(path, robot, rules, judge)


def mapping_of(path: Path, given: str | Path | None) -> Mapping | None:
    """Mapping of a recording: `given`, or the one beside the recording; None if there is none."""
    if given is not None:
        return mapping.load(given)
    default = (path if path.is_dir() else path.parent) / mapping.FILE
    return mapping.load(default) if default.is_file() else None


def _from_bag(bag: Bag, robot: Robot, rules: Mapping | None, judge: bool) -> list[Record]:
    name = bag.folder.name
    rules = rules or Mapping(bag.path)
    if rules.columns:
        source = FieldSource(bag, name)
        return importing.records(source, robot, rules, bag.path.name, judge)
    signals, notes = gap_topics.read(bag, robot, rules.namespace, rules.base_pose)
    signals = tracks.without(signals, rules.missing, notes)
    settings = _experiment(bag) | rules.overrides
    step = _simulated(bag)
    matching = [r for r in rules.records if importing.fits(r, bag.path.name, {})]
    if not matching:
        raise BagError(f"no record of {rules.path} fits {bag.path.name}; see its 'records'")
    return [
        record
        for i, rule in enumerate(matching)
        for record in align.records(
            rule.name or (f"{name} {i + 1}" if len(matching) > 1 else name),
            [_cut(track, rule) for track in signals],
            robot,
            rate=rules.rate,
            role=rule.role,
            overrides=settings | rule.overrides,
            notes=notes,
            trust_units=rules.trust_units,
            simulated=step,
            mend=rules.mend,
            judge=judge,
        )
    ]


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
    return {key: overrides[key] for key in _KNOWN if key in (overrides or {})}


def _simulated(bag: Bag) -> float:
    """Physics step of the recorded simulation [s]; 0 for a real robot or if unknown."""
    about = bag.metadata
    try:
        step = 0.0 if "hardware" in about else float(about.get(STEP, 0.0))
    except ValueError:
        return 0.0
    return step if 0.0 < step < 1.0 else 0.0
