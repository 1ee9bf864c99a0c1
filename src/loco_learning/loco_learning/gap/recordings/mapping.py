# SPDX-License-Identifier: Apache-2.0
"""``mapping.yaml``: the meaning of the columns of a recording.

    files: "*.csv"
    time: {column: t, unit: ms}
    columns:
      - {column: angle, role: q, joint: knee, unit: deg, sign: -1}
      - {column: goal, role: command_position, joint: knee, unit: deg, sign: -1}
    records:
      - {from: 1.0, to: 8.0}
      - {file: last.csv, role: held-out}

A value is ``sign · scale · unit · raw + offset``, the offset in the SI unit of the role.
All keys are in ``docs/gap_import.md``.
"""

from __future__ import annotations

from collections.abc import Mapping as Values
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from loco_control.exceptions import NameUnknownError, ParameterError
from loco_control.reading import parse_yaml, read_text, shown, understood

from . import units
from .record import FIT, HELD_OUT

FILE = "mapping.yaml"
FORMAT = 1
UNUSED = "unused"
WRAPS = ("none", "unsigned8", "unsigned16", "unsigned32", "2pi")

# Dimension of a role, and whether it belongs to a joint, a foot, an axis or the robot.
ROLES: dict[str, tuple[tuple[str, ...], str]] = {
    "command_position": (("angle", "length"), "joint"),
    "command_velocity": (("turning rate", "speed"), "joint"),
    "command_torque": (("torque", "force"), "joint"),
    "q": (("angle", "length"), "joint"),
    "dq": (("turning rate", "speed"), "joint"),
    "tau": (("torque", "force"), "joint"),
    "gyro": (("turning rate",), "axis"),
    "acceleration": (("acceleration",), "axis"),
    "orientation": (("ratio",), "axis"),
    "base_position": (("length",), "axis"),
    "base_orientation": (("ratio",), "axis"),
    "grf": (("force",), "foot"),
    "stance": (("ratio",), "foot"),
    "supply": (("ratio",), ""),
    "enable": (("ratio",), ""),
    UNUSED: ((), ""),
}
WHERE = ("joint", "axis", "foot")
SOURCES = ("column", "file", "topic", "time")
BETWEEN = ("hold", "line")
CLOCKS = ("stamp", "log", "receive")  # log and receive are synonyms: time of reception
# [s] at rest, simulated in full, and of the physics of a recorded simulation; highest rate [Hz]
# (all taste).
LONGEST_REST, LONGEST_STEP, HIGHEST = 60.0, 0.1, 1e9
_COLUMN = (*SOURCES, "role", *WHERE, "unit", "sign", "scale", "offset", "wrap", "between", "clock",
           "missing")  # fmt: skip
_RECORD = ("name", "file", "where", "rows", "from", "to", "rest", "role", "overrides")
_KEYS = (
    *("format", "description", "files", "samples", "time", "rate", "physics_step", "columns"),
    *("header", "overrides", "records", "namespace", "base_pose", "trust_units", "locked", "mend"),
    *("missing", "undriven"),
)


@dataclass(frozen=True)
class Column:
    """One column of a file, or one field of a topic.

    Attributes:
        column: Name in the file, or path of the field in the topic's messages.
        role: Role of the values, one of `ROLES`.
        place: Joint, axis (x, y, z, w) or foot; empty if the role has none.
        unit: Unit of the values, one of `units.UNITS`; empty is the SI unit of the role.
        gain: Factor on the raw value: sign times scale times size of the unit.
        offset: Added last, in the SI unit of the role.
        wrap: Wrap of the values, one of `WRAPS`.
        file: Other file of the same folder that has the column.
        topic: Topic that has the field, in a bag.
        time: Column with the times of this column, if it has its own.
        clock: Clock of a topic's messages, one of `CLOCKS`; empty: header stamps if present.
        between: Course between samples, one of `BETWEEN`: held, or linear to the next sample.
        missing: Raw value that means no reading; None if every value is a reading.
        missing_texts: Texts of a table that mean no reading.
    """

    column: str
    role: str
    place: str = ""
    unit: str = ""
    gain: float = 1.0
    offset: float = 0.0
    wrap: str = "none"
    file: str = ""
    topic: str = ""
    time: str = ""
    between: str = ""
    clock: str = ""
    missing: float | None = None
    missing_texts: tuple[str, ...] = ()


@dataclass(frozen=True)
class Mend:
    """A correction of the imported signals of a role and joint, for any source.

    Attributes:
        role: Role of the signals, one of `ROLES`.
        place: Joint, axis or foot; empty if the role has none, or for all.
        gain: Factor on the values: sign times scale times size of the unit.
        offset: Added last, in the SI unit of the role.
        period: Period at which the values wrap, in their unit; 0 if they do not.
        other: Joint to which the signals really belong; empty for no change.
    """

    role: str
    place: str = ""
    gain: float = 1.0
    offset: float = 0.0
    period: float = 0.0
    other: str = ""


@dataclass(frozen=True)
class Header:
    """A field of a log's header that is a value of ``robot.yaml``: scale · field + offset."""

    override: str
    scale: float = 1.0
    offset: float = 0.0


@dataclass(frozen=True)
class Rule:
    """A record to be made of each matching file.

    Attributes:
        name: Name of the record, with ``{field}`` for a field of the header; empty is the name of
            the file, with the number of the part.
        file: Pattern of the file's name.
        where: Required fields of the header, each with its permitted values.
        rows: First row, and row after the last; None is the start or end.
        start: First time [s] on the clock of the file.
        end: Last time [s].
        rest: Start of the robot's rest relative to the start of the record [s], at most 0.
        role: `record.FIT` or `record.HELD_OUT`.
        overrides: Known values of ``robot.yaml`` for this record.
    """

    name: str = ""
    file: str = "*"
    where: dict[str, tuple] = field(default_factory=dict)
    rows: tuple[int | None, int | None] = (None, None)
    start: float = -float("inf")
    end: float = float("inf")
    rest: float = 0.0
    role: str = FIT
    overrides: dict[str, Any] = field(default_factory=dict)


@dataclass(frozen=True)
class Mapping:
    """A checked ``mapping.yaml``; the attributes are its keys."""

    path: Path
    files: tuple[str, ...] = ("*",)
    samples: str = ""
    time: str = ""
    time_unit: float = 1.0
    time_rate: float = 0.0
    rate: float = 0.0
    physics_step: float = 0.0
    columns: tuple[Column, ...] = ()
    header: dict[str, Header] = field(default_factory=dict)
    overrides: dict[str, Any] = field(default_factory=dict)
    records: tuple[Rule, ...] = (Rule(),)
    namespace: str = ""
    base_pose: bool = False
    trust_units: bool = False
    locked: dict[str, float] = field(default_factory=dict)
    mend: tuple[Mend, ...] = ()
    missing: float | None = None
    undriven: tuple[str, ...] = ()


@understood("whole mapping")
def load(path: str | Path) -> Mapping:
    """Read and check a mapping.

    Raises:
        MissingFileError: The file does not exist.
        ParameterError: The file is not a mapping, or a value is invalid.
        NameUnknownError: A key, role or unit does not exist.
    """
    path = Path(path)
    path = path / FILE if path.is_dir() else path
    return loads(read_text(path, "mapping"), path)


def loads(text: str, path: str | Path = FILE) -> Mapping:
    """Check the text of a mapping; `path` is its location.

    Raises:
        LocoError: The text is not a mapping.
    """
    path = Path(path)
    values = _keys(parse_yaml(text, path.name), _KEYS, str(path.name))
    if values.get("format", FORMAT) != FORMAT:
        raise ParameterError(
            f"{path.name} has format {values['format']!r}; this version reads {FORMAT}"
        )
    time = _keys(values.get("time") or {}, ("column", "unit", "rate", "scale"), "time")
    scale = units.number(time.get("scale", 1.0), "time.scale")
    if not 1e-3 <= scale <= 1e3 or ("scale" in time and "column" not in time):
        raise ParameterError(
            f"{path.name}: time.scale must be 0.001 to 1000, and needs time.column; got {scale:g}"
        )
    unit = scale * _unit(time.get("unit", "s"), ("time",), "time", False)
    header = _keys(values.get("header") or {}, None, "header")
    return Mapping(
        path,
        files=_files(values.get("files", "*"), path),
        samples=str(values.get("samples") or ""),
        time=str(time.get("column", "")),
        time_unit=unit,
        time_rate=_positive(time.get("rate", 0.0), "time.rate [Hz]"),
        rate=_positive(values.get("rate", 0.0), "rate [Hz]"),
        physics_step=_positive(values.get("physics_step", 0.0), "physics_step [s]", LONGEST_STEP),
        columns=tuple(
            column for i, c in enumerate(_list(values, "columns")) for column in _columns(c, i)
        ),
        header={str(k): _header(k, v) for k, v in header.items()},
        overrides=_keys(values.get("overrides") or {}, None, "overrides"),
        records=tuple(_rule(r, i) for i, r in enumerate(_list(values, "records"))) or (Rule(),),
        namespace=str(values.get("namespace") or ""),
        base_pose=_yes(values, "base_pose"),
        trust_units=_yes(values, "trust_units"),
        mend=tuple(_mend(m, i) for i, m in enumerate(_list(values, "mend"))),
        locked={
            str(joint): units.number(at, f"locked.{joint}")
            for joint, at in _keys(values.get("locked") or {}, None, "locked").items()
        },
        missing=_missing(values, "missing"),
        undriven=tuple(map(str, _list(values, "undriven"))),
    )


def _files(patterns: Any, path: Path) -> tuple[str, ...]:
    """Patterns of files in the folder of a mapping."""
    patterns = tuple(map(str, patterns)) if isinstance(patterns, list) else (str(patterns),)
    for pattern in patterns:
        if not pattern or Path(pattern).is_absolute() or ".." in Path(pattern).parts:
            raise ParameterError(
                f"{path.name}: files must name files in its folder, such as '*.csv', "
                f"got {shown(pattern)}"
            )
    return patterns


def _columns(value: Any, index: int) -> list[Column]:
    """Column of an entry; for a list of joints one column each: ``q`` is ``q[0]``, ``q[1]``."""
    joints = value.get("joint") if isinstance(value, Values) else None
    if not isinstance(joints, list):
        return [_column(value, index)]
    name = str(value.get("column", ""))
    return [
        _column({**value, "column": f"{name}[{i}]", "joint": joint}, index)
        for i, joint in enumerate(joints)
        if joint is not None
    ]


def _column(value: Any, index: int) -> Column:
    where = f"columns[{index}]"
    value = _keys(value, _COLUMN, where)
    role = _role(value, where)
    if "column" not in value:
        raise ParameterError(f"{where} ({role}) names no column")
    name = str(value["column"])
    dimensions, kind = ROLES[role]
    if kind and kind not in value:
        raise ParameterError(f"column {name!r} has the role {role} and must name its {kind}")
    sign = _sign(value, f"of column {name!r}")
    wrap = str(value.get("wrap", "none"))
    if wrap not in WRAPS:
        raise NameUnknownError(f"wrap of column {name!r}", wrap, WRAPS)
    between = str(value.get("between", ""))
    if "between" in value and (between not in BETWEEN or not role.startswith("command_")):
        raise ParameterError(
            f"between of column {name!r} must be {' or '.join(BETWEEN)}, of a command"
        )
    clock = str(value.get("clock", ""))
    if "clock" in value and (clock not in CLOCKS or "topic" not in value):
        raise ParameterError(
            f"clock of column {name!r} must be {', '.join(CLOCKS[:-1])} or {CLOCKS[-1]}, of a "
            f"topic in a bag; got {clock!r}"
        )
    scale = units.number(value.get("scale", 1.0), f"scale of column {name!r}")
    missing, missing_texts = _absent(value.get("missing", []), f"missing of column {name!r}")
    size = 1.0
    if "unit" in value and role != UNUSED:
        size = _unit(value["unit"], dimensions, f"column {name!r} ({role})", "scale" in value)
    return Column(
        name,
        role,
        place=str(value.get(kind, "")) if kind else "",
        unit=units.unit(value["unit"]) if "unit" in value else "",
        gain=sign * scale * size,
        offset=units.number(value.get("offset", 0.0), f"offset of column {name!r}"),
        wrap=wrap,
        between=between,
        clock=clock,
        missing=missing,
        missing_texts=missing_texts,
        **{key: str(value.get(key, "")) for key in ("file", "topic", "time")},
    )


def _role(value: Values, where: str) -> str:
    role = str(value.get("role"))
    if role not in ROLES:
        raise NameUnknownError(f"role in {where}", role, ROLES)
    return role


def _sign(value: Values, where: str) -> int:
    sign = value.get("sign", 1)
    if sign not in (1, -1):
        raise ParameterError(f"sign {where} must be 1 or -1, got {shown(sign)}")
    return sign


def _absent(entries: Any, what: str) -> tuple[float | None, tuple[str, ...]]:
    """Number and texts that stand for missing values."""
    entries = entries if isinstance(entries, list) else [entries]
    markers = tuple(text for text in entries if isinstance(text, str) and not _is_number(text))
    numbers = [units.number(entry, what) for entry in entries if entry not in markers]
    if len(numbers) > 1:
        raise ParameterError(f"{what} may have one number, got {entries!r}")
    return (numbers[0] if numbers else None), markers


def _mend(value: Any, index: int) -> Mend:
    where = f"mend[{index}]"
    value = _keys(value, ("role", *WHERE, "is", "sign", "scale", "unit", "offset", "wrap"), where)
    role, sign = _role(value, where), _sign(value, f"in {where}")
    kind = ROLES[role][1]
    if "is" in value and kind != "joint":
        raise ParameterError(f"{where}: is names another joint, and {role} is of no joint")
    size = _unit(value["unit"], ROLES[role][0], where, "scale" in value) if "unit" in value else 1.0
    return Mend(
        role,
        str(value.get(kind, "")) if kind else "",
        sign * size * units.number(value.get("scale", 1.0), f"scale in {where}"),
        units.number(value.get("offset", 0.0), f"offset in {where}"),
        _positive(value.get("wrap", 0.0), f"wrap in {where}"),
        str(value.get("is", "")),
    )


def _unit(name: Any, dimensions: tuple[str, ...], what: str, scaled: bool) -> float:
    """Size of a unit in the SI unit of its dimension; one of another dimension needs a scale."""
    if units.dimension(name) not in dimensions and not scaled:
        legal = [u for u, (d, _) in units.UNITS.items() if d in dimensions]
        raise ParameterError(
            f"{what} is in {units.unit(name)}, a unit of {units.dimension(name)}, not of "
            f"{' or '.join(dimensions)} ({', '.join(legal)}): correct the unit, or give a scale "
            "that converts it"
        )
    return units.factor(name)


def _header(name: Any, value: Any) -> Header:
    where = f"header.{name}"
    value = _keys(value, ("override", "scale", "offset"), where)
    if not value.get("override"):
        raise ParameterError(f"{where} must name the override that it sets")
    return Header(
        str(value["override"]),
        units.number(value.get("scale", 1.0), f"{where}.scale"),
        units.number(value.get("offset", 0.0), f"{where}.offset"),
    )


def _rule(value: Any, index: int) -> Rule:
    where = f"records[{index}]"
    value = _keys(value, _RECORD, where)
    role = str(value.get("role", FIT))
    if role not in (FIT, HELD_OUT):
        raise NameUnknownError(f"role in {where}", role, (FIT, HELD_OUT))
    rows = value.get("rows", [None, None])
    valid = isinstance(rows, list) and all(r is None or (type(r) is int and r >= 0) for r in rows)
    if not valid or len(rows) != 2 or (None not in rows and rows[0] >= rows[1]):
        raise ParameterError(f"{where}.rows must be [first, stop], rows from 0, got {rows!r}")
    fields = _keys(value.get("where") or {}, None, f"{where}.where")
    conditions = {str(k): tuple(v) if isinstance(v, list) else (v,) for k, v in fields.items()}
    limits = {}
    for key, name in (("from", "start"), ("to", "end")):
        if key in value:
            limits[name] = units.number(value[key], f"{where}.{key}")
    rest = units.number(value.get("rest", 0.0), f"{where}.rest")
    if not -LONGEST_REST <= rest <= 0.0:
        raise ParameterError(
            f"{where}.rest is when the robot came to rest before the record begins: from "
            f"{-LONGEST_REST:g} to 0 s, got {rest:g}"
        )
    return Rule(
        rest=rest,
        name=str(value.get("name") or ""),
        file=str(value.get("file") or "*"),
        where=conditions,
        rows=tuple(rows),
        role=role,
        overrides=_keys(value.get("overrides") or {}, None, f"{where}.overrides"),
        **limits,
    )


def _keys(value: Any, legal: tuple[str, ...] | None, where: str) -> dict[str, Any]:
    if not isinstance(value, Values):
        raise ParameterError(f"{where} must be a mapping of names to values, got {value!r}")
    for key in value:
        if legal is not None and key not in legal:
            raise NameUnknownError(f"key in {where}", str(key), legal)
    return dict(value)


def _list(values: dict[str, Any], key: str) -> list:
    value = values.get(key) or []
    if not isinstance(value, list):
        raise ParameterError(f"{key} must be a list, got {value!r}")
    return value


def _missing(values: dict[str, Any], what: str) -> float | None:
    """Value that means no reading; None if not given."""
    return units.number(values["missing"], what) if "missing" in values else None


def _is_number(text: str) -> bool:
    """True for a number, or an expression of numbers, as text."""
    try:
        units.number(text, text)
    except ParameterError:
        return False
    return True


def _yes(values: dict[str, Any], key: str) -> bool:
    value = values.get(key, False)
    if not isinstance(value, bool):
        raise ParameterError(f"{key} must be true or false, got {value!r}")
    return value


def _positive(value: Any, what: str, maximum: float = HIGHEST) -> float:
    result = units.number(value, what)
    if not 0.0 <= result <= maximum:
        raise ParameterError(f"{what} must be 0 to {maximum:g}, got {value!r}")
    return result
