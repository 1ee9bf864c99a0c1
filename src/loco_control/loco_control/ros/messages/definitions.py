# SPDX-License-Identifier: Apache-2.0
"""Message definitions in the format of ``.msg`` files: fields, full texts and type hashes.

A bag contains the definition of each of its message types, so it can be read without their
packages. Where ROS is not installed, the definitions for the topics of loco are in `_LOCO_MSGS` and
`_STANDARD`.
"""

from __future__ import annotations

import hashlib
import json
import os
import re
import sys
from collections.abc import Iterator, Mapping
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

from ...exceptions import NameUnknownError, ParameterError
from ...reading import parse_yaml

SEPARATOR = "=" * 80  # between the definitions of a message and of its nested messages
MOST_FIELDS = 1000  # largest number of fields of one message
_FOLDER = Path(__file__).parent / "texts"
_STANDARD, _LOCO_MSGS = _FOLDER / "standard.msg", _FOLDER / "loco_msgs"
# Types of .msg files: name in IDL, type id that enters the hash, and code for struct and NumPy.
PRIMITIVES = {
    "bool": ("boolean", 15, "?"), "byte": ("octet", 16, "B"), "char": ("uint8", 3, "B"),
    "float32": ("float", 10, "f"), "float64": ("double", 11, "d"), "int8": ("int8", 2, "b"),
    "uint8": ("uint8", 3, "B"), "int16": ("int16", 4, "h"), "uint16": ("uint16", 5, "H"),
    "int32": ("int32", 6, "i"), "uint32": ("uint32", 7, "I"), "int64": ("int64", 8, "q"),
    "uint64": ("uint64", 9, "Q"), "string": ("string", 17, ""), "wstring": ("wstring", 18, ""),
}  # fmt: skip
_NESTED, _BOUNDED_TEXT = 1, 4  # type id of a message; offset of the id of a bounded text
_ARRAYS = {"fixed": 48, "bounded": 96, "sequence": 144}  # offset of the type id of an array
_LINE = re.compile(
    r"(?P<base>[A-Za-z][\w/]*)(?:<=(?P<text>\d+))?(?P<array>\[(?P<most><=)?(?P<count>\d*)\])?"
    r"\s+(?P<name>[A-Za-z]\w*)\s*(?P<rest>.*)$"
)


class Field(NamedTuple):
    """One field of a message.

    Attributes:
        name: Name of the field.
        base: Type of an element: a primitive type of ``.msg`` files or ``package/Type``.
        text: Largest length of a text [characters]; 0 for no limit.
        array: ``fixed``, ``bounded``, ``sequence``, or empty for a single value.
        count: Length of a fixed array, greatest length of a bounded sequence, else 0.
        default: Value of a new message; None for zero.
    """

    name: str
    base: str
    text: int = 0
    array: str = ""
    count: int = 0
    default: Any = None

    @property
    def kind(self) -> str:
        """Type in the notation of the ROS message classes, e.g. ``sequence<double>``."""
        element = PRIMITIVES[self.base][0] if self.base in PRIMITIVES else self.base
        element += f"<{self.text}>" if self.text else ""
        if self.array == "fixed":
            return f"{element}[{self.count}]"
        if self.array == "bounded":
            return f"sequence<{element}, {self.count}>"
        return f"sequence<{element}>" if self.array else element

    @property
    def is_message(self) -> bool:
        """Whether an element is a message itself."""
        return self.base not in PRIMITIVES


def parse(text: str, package: str) -> tuple[Field, ...]:
    """Fields of the text of one ``.msg`` file; constants are left out.

    Args:
        text: Content of the file.
        package: Package of types that are named without a package.

    Raises:
        ParameterError: A line is not a field, or there are too many fields.
    """
    fields = []
    for line in text.splitlines():
        line = line.split("#")[0].strip()
        if not line or re.match(r"[\w<=]+\s+\w+\s*=", line):  # empty, or a constant
            continue
        match = _LINE.match(line)
        if match is None:
            raise ParameterError(f"{line[:80]!r} is no field of a message")
        fields.append(_field(match, package))
        if len(fields) > MOST_FIELDS:
            raise ParameterError(f"a message has more than {MOST_FIELDS} fields")
    return tuple(fields)


def _field(match: re.Match, package: str) -> Field:
    base = match["base"]
    if base not in PRIMITIVES and "/" not in base:
        base = f"std_msgs/{base}" if base == "Header" else f"{package}/{base}"
    base = base.replace("/msg/", "/")
    array = ""
    if match["array"]:
        array = "bounded" if match["most"] else "fixed" if match["count"] else "sequence"
    default = parse_yaml(match["rest"], f"default of {match['name']}") if match["rest"] else None
    return Field(
        match["name"], base, int(match["text"] or 0), array, int(match["count"] or 0), default
    )


def split(text: str, name: str) -> dict[str, tuple[Field, ...]]:
    """Fields of a message and of all its nested messages, by ``package/Type``.

    Args:
        text: Texts of several ``.msg`` files, in the form of MCAP's ``ros2msg`` schemas.
        name: Name of the first message, ``package/msg/Type``.

    Raises:
        ParameterError: The text is not a message definition.
    """
    sections = {}
    for short, part in _parts(text, name.replace("/msg/", "/")):
        sections[short] = parse(part, short.partition("/")[0])
    return sections


def _parts(text: str, name: str) -> Iterator[tuple[str, str]]:
    for i, part in enumerate(re.split(r"^={3,}\s*$", text, flags=re.MULTILINE)):
        if i:
            head, _, part = part.lstrip().partition("\n")
            name = head.removeprefix("MSG:").strip().replace("/msg/", "/")
        yield name, part


# ---- installed definitions, and those of loco-----------------------------------------------


@cache
def definition(name: str) -> str:
    """Definition of a message and its nested messages, in the format of MCAP's ``ros2msg`` schema.

    Args:
        name: Full name, ``package/msg/Type``.

    Raises:
        NameUnknownError: The message is neither installed nor used by a topic of loco.
    """
    short = name.replace("/msg/", "/")
    sections = [_text(short)]
    sections += [f"{SEPARATOR}\nMSG: {other}\n{_text(other)}" for other in _contained(short)]
    return "\n".join(sections)


@cache
def fields_of(short: str) -> tuple[Field, ...]:
    """Fields of a message ``package/Type``.

    Raises:
        NameUnknownError: The message is neither installed nor used by a topic of loco.
    """
    return parse(_text(short), short.partition("/")[0])


def _contained(short: str) -> list[str]:
    """Messages that a message contains, at any depth, sorted."""
    types: set[str] = set()
    todo = [short]
    while todo:
        inner = {f.base for f in fields_of(todo.pop()) if f.is_message} - types
        types |= inner
        todo += inner
    return sorted(types)


@cache
def _text(short: str) -> str:
    package, _, name = short.partition("/")
    folders = [Path(prefix) / "share" / package / "msg" for prefix in _prefixes()]
    if package == _LOCO_MSGS.name:
        folders.append(_LOCO_MSGS)
    folder = next((f for f in folders if f.is_dir()), None)
    if folder is not None and (folder / f"{name}.msg").is_file():
        return (folder / f"{name}.msg").read_text(encoding="utf-8")
    if short in _standard():
        return _standard()[short]
    if folder is None:
        raise NameUnknownError("installed message package", package, _packages())
    raise NameUnknownError(f"message in {package}", name, [p.stem for p in folder.glob("*.msg")])


@cache
def _standard() -> dict[str, str]:
    text = _STANDARD.read_text(encoding="utf-8")
    return {name: part.strip() + "\n" for name, part in _parts(text, "") if name}


def _prefixes() -> list[str]:
    # Wheels install into the environment's prefix, which is not in the ament path.
    return [*filter(None, os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep)), sys.prefix]


def _packages() -> list[str]:
    included = {name.partition("/")[0] for name in _standard()} | {_LOCO_MSGS.name}
    installed = {p.parent.name for prefix in _prefixes() for p in Path(prefix).glob("share/*/msg")}
    return sorted(included | installed)


# ---- hashes ---------------------------------------------------------------------------------


@cache
def type_hash(name: str) -> str:
    """RIHS01 hash of a message, as DDS endpoints announce it (REP 2016).

    Args:
        name: Full name, ``package/msg/Type``.

    Raises:
        NameUnknownError: The message is neither installed nor used by a topic of loco.
    """
    short = name.replace("/msg/", "/")
    described = {
        "type_description": _described(short),
        "referenced_type_descriptions": [_described(other) for other in _contained(short)],
    }
    text = json.dumps(described, separators=(", ", ": "))
    return "RIHS01_" + hashlib.sha256(text.encode()).hexdigest()


def _described(short: str) -> Mapping[str, Any]:
    fields = fields_of(short) or (Field("structure_needs_at_least_one_member", "uint8"),)
    return {
        "type_name": short.replace("/", "/msg/"),
        "fields": [{"name": f.name, "type": _described_type(f)} for f in fields],
    }


def _described_type(field: Field) -> Mapping[str, Any]:
    number = _NESTED if field.is_message else PRIMITIVES[field.base][1]
    number += (_BOUNDED_TEXT if field.text else 0) + _ARRAYS.get(field.array, 0)
    return {
        "type_id": number,
        "capacity": field.count,
        "string_capacity": field.text,
        "nested_type_name": field.base.replace("/", "/msg/") if field.is_message else "",
    }
