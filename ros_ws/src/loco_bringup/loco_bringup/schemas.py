# SPDX-License-Identifier: Apache-2.0
"""JSON Schemas of the YAML files, generated from the classes that read them.

Editors use them for completion and checks: through a first line
``# yaml-language-server: $schema=FILE`` in a file, or a table of files and schemas in the
editor's settings. A schema covers keys, types, ranges and choices. Only loco itself checks
whether a joint, link or file exists, and whether several values are consistent.
"""

from __future__ import annotations

import dataclasses
import math
import types
import typing
from collections.abc import Callable, Iterable, Mapping
from typing import Any

from loco_control.exceptions import NameUnknownError
from loco_control.gait.generator import GaitParams
from loco_control.gait.oscillators import CpgParams
from loco_control.names import JOINT_KINDS, LEGS
from loco_learning.gap.recordings import mapping
from loco_learning.metrics.registry import METRICS
from loco_learning.params import PHASES
from loco_learning.runs import gait_file
from loco_learning.runs.experiment import Experiment
from loco_learning.runs.network_experiment import NetworkExperiment
from loco_learning.study import grid
from loco_learning.study.figures import FIGURES
from loco_sim.effects import EFFECTS
from loco_sim.engines import ENGINES
from loco_sim.hardware import wiring
from loco_sim.params import SimParams
from loco_sim.plant import model
from loco_sim.robot import equipment
from loco_sim.robot.robot import FallLimits
from loco_sim.robot.sensors import SensorParams
from loco_sim.robot.servo import DRIVES
from loco_sim.robot.spring import SpringParams

DIALECT = "https://json-schema.org/draft/2020-12/schema"
Schema = dict[str, Any]

NUMBER: Schema = {"type": "number"}
TEXT: Schema = {"type": "string"}
TRUTH: Schema = {"type": "boolean"}
NUMBERS: Schema = {"type": "array", "items": NUMBER}
TEXTS: Schema = {"type": "array", "items": TEXT}
MAPPING: Schema = {"type": "object"}
OVERRIDES: Schema = {**MAPPING, "description": "values to change, by dotted name"}


def schema(kind: str) -> Schema:
    """JSON Schema (2020-12) of a kind of file.

    Args:
        kind: One of `SCHEMAS`.

    Raises:
        NameUnknownError: There is no such kind.
    """
    if kind not in SCHEMAS:
        raise NameUnknownError("kind of file", kind, SCHEMAS)
    title, make = SCHEMAS[kind]
    return {"$schema": DIALECT, "title": title, **make()}


def of_params(cls: type, **overrides: Schema) -> Schema:
    """Schema of a mapping that `loco_control.params` reads as a parameter class.

    Args:
        cls: A class of parameters; nested ones become nested mappings.
        overrides: Schemas of keys that the class does not read, or reads differently.
    """
    type_of = typing.get_type_hints(cls)
    keys = {f.name: _of_field(f, type_of[f.name]) for f in dataclasses.fields(cls)}
    doc = (cls.__doc__ or "").strip().splitlines()[0]
    return {"description": doc, **_mapping({**keys, **overrides})}


def _of_field(f: dataclasses.Field, hint: Any) -> Schema:
    classes = [kind for kind in _alternatives(hint) if dataclasses.is_dataclass(kind)]
    if classes:
        return _nullable(*map(of_params, classes)) | _about(f)
    default = f.metadata.get("factory", lambda: f.default)()
    if default is None:  # the class checks it itself
        value = {"type": ["array", "null"], "items": MAPPING}
    elif isinstance(default, tuple):
        each = _of_scalar(default[0] if default else 0.0, f.metadata)
        size: Schema = {"minItems": len(default), "maxItems": len(default)} if default else {}
        size = {"minItems": 1} if f.metadata.get("any_length") else size
        value = {"type": "array", "items": each, **size}
    else:
        value = _of_scalar(default, f.metadata)
    has_default = default is not dataclasses.MISSING and default not in (math.inf, -math.inf)
    displayed = list(default) if isinstance(default, tuple) else default
    return value | _about(f) | ({"default": displayed} if has_default else {})


def _of_scalar(default: Any, meta: Mapping[str, Any]) -> Schema:
    if isinstance(default, bool):
        return TRUTH
    if isinstance(default, str):
        return {"enum": list(meta["choices"])} if meta.get("choices") else TEXT
    kind = "integer" if isinstance(default, int) else "number"
    bounds = {"minimum": meta.get("low"), "maximum": meta.get("high")}
    return {"type": kind, **{key: end for key, end in bounds.items() if end is not None}}


def _about(f: dataclasses.Field) -> Schema:
    doc, unit = f.metadata.get("doc", ""), f.metadata.get("unit", "-")
    return {"description": doc + ("" if unit == "-" else f" [{unit}]")} if doc else {}


def _alternatives(hint: Any) -> tuple[Any, ...]:
    union = typing.get_origin(hint) in (typing.Union, types.UnionType)
    return typing.get_args(hint) if union else (hint,)


def _mapping(keys: Mapping[str, Schema], required: Iterable[str] = ()) -> Schema:
    """Schema of a mapping with these keys and no others."""
    needed = {"required": list(required)} if required else {}
    return {**MAPPING, "properties": dict(keys), "additionalProperties": False, **needed}


def _nullable(*several: Schema) -> Schema:
    return {"anyOf": [*several, {"type": "null"}]}


def _by_name(each: Schema, what: str) -> Schema:
    """Schema of a mapping whose keys are names or fnmatch patterns."""
    return {**MAPPING, "description": f"by {what}, or pattern", "additionalProperties": each}


def _effects() -> Schema:
    """Schema of a list of effects, distinguished by their names."""
    variants = [
        {**of_params(cls, name={"const": name}), "required": ["name"]}
        for name, cls in sorted(EFFECTS.items())
    ]
    names = {"properties": {"name": {"enum": sorted(EFFECTS)}}, "required": ["name"]}
    items = {"allOf": [names, {"anyOf": variants}]}
    return {"type": ["array", "null"], "items": items, "description": "effects, in order"}


def _experiment() -> Schema:
    """Schema of an experiment with a robot or with a mass-spring network."""
    base = {**TEXT, "description": "name or path of the experiment that this one changes"}
    gait = {**TEXT, "description": "name or path of a gait file"}
    target = of_params(CpgParams, gait=gait)
    special = {
        "extends": base,
        "target": _nullable(gait, target),
        "sim": _nullable(of_params(SimParams)),
        "effects": _effects(),
        "overrides": _nullable(OVERRIDES),
    }
    preset = {**TEXT, "description": "constants that `network` may change"}
    network = of_params(NetworkExperiment, extends=base, preset=preset)
    return {"anyOf": [of_params(Experiment, **special), network]}


def _robot() -> Schema:
    leg = _mapping(dict.fromkeys((*JOINT_KINDS, "foot"), TEXT), (*JOINT_KINDS, "foot"))
    deviation = {"anyOf": [NUMBER, {**TEXT, "pattern": "%$"}]}
    keys = {
        "urdf": {**TEXT, "description": "URDF in the same folder"},
        "joints": {**TEXTS, "description": "actuated joints, in the order of all arrays"},
        "feet": {**_nullable(TEXTS), "description": "links whose ground reaction is sensed"},
        "standing": {**_nullable(NUMBERS), "description": "joint positions at the start [rad]"},
        "legs": {**_mapping(dict.fromkeys(LEGS, leg)), "description": "legs of a quadruped"},
        "control_rate": {**NUMBER, "description": "usual rate of commands [Hz]"},
        "locked": _by_name({**NUMBER, "description": "fixed at [rad or m]"}, "joint"),
        "height": {**_nullable(NUMBER), "description": "height of the base at the start [m]"},
        "fixed_base": {**TRUTH, "description": "the base is bolted to the world"},
        "drives": _by_name(_drive(), "joint"),
        "springs": _by_name(of_params(SpringParams), "joint"),
        "dynamics": _by_name(of_params(equipment.DynamicsParams), "joint"),
        "contacts": _by_name(of_params(equipment.ContactParams), "link"),
        "masses": _by_name({**NUMBER, "description": "with all that hangs on it [kg]"}, "link"),
        "bodies": _by_name(of_params(equipment.BodyParams), "link"),
        **{k: of_params(v) for k, v in (("sensors", SensorParams), ("sim", SimParams))},
        "fall": of_params(FallLimits),
        "guessed": {**_nullable(TEXTS), "description": "guesses of a draft: control_rate, drives"},
        "uncertain": _by_name({**deviation, "description": "standard deviation"}, "dotted name"),
    }
    return _mapping(keys, ("urdf", "joints"))


def _drive() -> Schema:
    """Schema of a drive entry; all keys are optional, since entries are merged."""
    variants = [of_params(cls, kind={"const": kind}) for kind, cls in DRIVES.items()]
    return {"anyOf": variants, "properties": {"kind": {"enum": list(DRIVES)}}}


def _model() -> Schema:
    keys = {
        "format": {"const": model.FORMAT},
        "robot": {**TEXT, "description": "name, or path of a robot.yaml"},
        "overrides": _nullable(OVERRIDES),
        "effects": _effects(),
    }
    return _mapping(keys, ("format", "robot"))


def _gait() -> Schema:
    by_type = {"str": TEXT, "float": NUMBER, "int": {"type": "integer"}}
    fields = dataclasses.fields(gait_file.Gait)
    keys = {f.name: by_type.get(str(f.type), MAPPING) for f in fields}
    keys["target"] = {"anyOf": [of_params(CpgParams), of_params(GaitParams)]}
    head = {"format": {"const": gait_file.FORMAT}, "kind": {"const": "gait"}}
    needed = [f.name for f in fields if f.default is f.default_factory]
    return _mapping({**head, **keys}, (*head, *needed))


def _study() -> Schema:
    variant = {**MAPPING, "properties": {"experiment": TEXT}, "required": ["experiment"]}
    spaced = {"type": "array", "items": NUMBER, "minItems": 3, "maxItems": 3}
    listed = {"type": "array", "minItems": 1}
    several = {
        "values": listed,
        **{key: {**spaced, "description": "first, last, points"} for key in grid.SPACINGS},
        "whole": {**TRUTH, "description": "rounded to whole numbers"},
        "sets": {**TEXTS, "description": "parameters that take the values, by dotted name"},
        "unit": TEXT,
    }
    end = {"type": ["number", "null"]}
    span = {"type": "array", "items": end, "minItems": 2, "maxItems": 2}
    spans = {**MAPPING, "additionalProperties": span}
    maps = {
        "x": TEXT, "y": TEXT, "metrics": TEXTS, "legal": spans, "iso_damping": NUMBERS,
        "regions": _by_name(_mapping({"where": spans, "what": spans}), "name"),
    }  # fmt: skip
    keys = {
        "extends": {**TEXT, "description": "name or path of the study that this one changes"},
        "name": TEXT,
        "description": TEXT,
        "variants": {**MAPPING, "additionalProperties": variant, "minProperties": 1},
        "axes": {**MAPPING, "additionalProperties": {"anyOf": [listed, _mapping(several)]}},
        "seeds": {"type": "array", "items": {"type": "integer", "minimum": 0}, "minItems": 1,
                  "uniqueItems": True},
        "phase": {"enum": list(PHASES)},
        "metrics": {"type": "array", "items": {"enum": list(METRICS)}},
        "figures": {"type": "array", "items": {"enum": list(FIGURES)}},
        "map": _mapping(maps),
        "overrides": OVERRIDES,
    }  # fmt: skip
    alternatives = [{"required": [key]} for key in ("variants", "extends")]
    return {**_mapping(keys), "anyOf": alternatives}


def _mapping_file() -> Schema:
    number = {"type": ["number", "string"]}  # 4096/2pi is valid too
    text_keys = dict.fromkeys((*mapping.SOURCES, *mapping.WHERE, "unit"), TEXT)
    column = _mapping(
        {
            **text_keys,
            "joint": {"type": ["string", "array"], "items": {"type": ["string", "null"]}},
            "unit": {"type": ["string", "number"]},
            "role": {"enum": list(mapping.ROLES)},
            "sign": {"enum": [1, -1]},
            "scale": number,
            "offset": number,
            "wrap": {"enum": list(mapping.WRAPS)},
            "between": {"enum": list(mapping.BETWEEN)},
        },
        ("column", "role"),
    )
    row = {"type": ["integer", "null"], "minimum": 0}
    record = _mapping(
        {
            "name": TEXT, "file": TEXT, "where": MAPPING, "overrides": OVERRIDES,
            "rows": {"type": "array", "items": row, "minItems": 2, "maxItems": 2},
            "from": number, "to": number, "rest": number,
            "role": {"enum": [mapping.FIT, mapping.HELD_OUT]},
        }
    )  # fmt: skip
    header = _mapping({"override": TEXT, "scale": number, "offset": number}, ("override",))
    keys = {
        "format": {"const": mapping.FORMAT},
        "description": TEXT,
        "files": {"anyOf": [TEXT, TEXTS]},
        "samples": TEXT,
        "time": _mapping({"column": TEXT, "unit": TEXT, "rate": number, "scale": number}),
        **dict.fromkeys(("rate", "physics_step"), number),
        "columns": {"type": "array", "items": column},
        "header": _by_name(header, "field of a log's header"),
        "overrides": OVERRIDES,
        "records": {"type": "array", "items": record},
        "namespace": TEXT,
        "base_pose": TRUTH,
        "trust_units": TRUTH,
        "locked": _by_name(number, "joint"),
    }
    return _mapping(keys)


def _wiring() -> Schema:
    servos = _by_name(of_params(wiring.JointServo), "joint")
    return _mapping({"bus": _nullable(of_params(wiring.BusParams)), "servos": servos}, ("servos",))


def _plan() -> Schema:
    entry = {
        "study": TEXT,
        "engine": {"enum": list(ENGINES)},
        "points": {"type": ["integer", "object", "null"]},
        "seeds": {"type": ["integer", "null"]},
        "overrides": OVERRIDES,
        "options": MAPPING,
        "base": TEXT,
        "change": TEXT,
    }
    return _by_name(_mapping(entry), "name of the entry")


SCHEMAS: dict[str, tuple[str, Callable[[], Schema]]] = {
    "experiment": ("an experiment of loco: loco run FILE", _experiment),
    "robot": ("robot.yaml of loco: a URDF and what it does not say", _robot),
    "model": ("model.yaml of loco: a robot with changed values and effects", _model),
    "gait": ("a gait that loco optimise wrote", _gait),
    "study": ("a study of loco: loco study FILE", _study),
    "mapping": ("mapping.yaml of loco: which column of a recording means what", _mapping_file),
    "wiring": ("a wiring file of loco: loco run --hardware FILE", _wiring),
    "plan": ("a plan of loco: loco reproduce --plan FILE", _plan),
}
