# SPDX-License-Identifier: Apache-2.0
"""Lines of a draft of ``mapping.yaml``."""

from __future__ import annotations

from dataclasses import dataclass, replace

JOINT = "joint"  # key of the place of most columns


@dataclass(frozen=True)
class Line:
    """A column of the draft.

    Attributes:
        column: Name of the column, or path of a field.
        role: Role of the values.
        joint: Joint of the values, or what else `key` says.
        why: Reason in words.
        unit: Unit; empty is the SI unit.
        topic: Topic in a bag.
        scale: Scale that the user has to fill in; empty where none is needed.
        offset: Offset in the SI unit; empty where none is needed.
        missing: Texts in the column that are no reading.
        is_named: Whether the column says the name or number of the joint.
        key: Key of the place, such as "joint" or "axis".
    """

    column: str
    role: str
    joint: str
    why: str
    unit: str = ""
    topic: str = ""
    scale: str = ""
    offset: str = ""
    missing: tuple[str, ...] = ()
    is_named: bool = True
    key: str = JOINT

    def also(self, why: str) -> Line:
        """The line with one more reason."""
        return replace(self, why=f"{self.why}; {why}")

    @property
    def text(self) -> str:
        """Line of the file."""
        topic = f"topic: {quoted(self.topic)}, " if self.topic else ""
        unit = f", unit: {self.unit}" if self.unit else ""
        scale = f", scale: {self.scale}" if self.scale else ""
        scale += f", offset: {self.offset}" if self.offset else ""
        missing = f", missing: [{', '.join(map(_text, self.missing))}]" if self.missing else ""
        return (
            f"  - {{{topic}column: {quoted(self.column)}, role: {self.role}, "
            f"{self.key}: {quoted(self.joint)}{unit}{scale}{missing}}}  # {self.why}"
        )


def quoted(text: str) -> str:
    """Text in quotation marks where YAML would otherwise read it as another type."""
    simple = text.replace("_", "a").isalnum() and not text[:1].isdigit()
    reserved = text.lower() in ("y", "n", "yes", "no", "on", "off", "true", "false", "null")
    return text if simple and not reserved else _text(text)


def _text(text: str) -> str:
    """Text in quotation marks for YAML."""
    escaped = text.replace("\\", "\\\\").replace('"', '\\"')
    return f'"{escaped}"'
