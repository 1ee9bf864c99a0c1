# SPDX-License-Identifier: Apache-2.0
"""Units that a mapping may name, and numbers as expressions, e.g. ``4096/2pi``."""

from __future__ import annotations

import ast
import math
import operator
import re
from typing import Any

import numpy as np

from loco_control.exceptions import NameUnknownError, ParameterError

TURN = 2.0 * math.pi
GRAVITY = 9.80665  # [m/s²]

# Dimension and size of each unit in the SI unit of its dimension.
UNITS: dict[str, tuple[str, float]] = {
    "s": ("time", 1.0),
    "ms": ("time", 1e-3),
    "us": ("time", 1e-6),
    "ns": ("time", 1e-9),
    "rad": ("angle", 1.0),
    "mrad": ("angle", 1e-3),
    "deg": ("angle", TURN / 360.0),
    "rev": ("angle", TURN),
    "m": ("length", 1.0),
    "cm": ("length", 1e-2),
    "mm": ("length", 1e-3),
    "um": ("length", 1e-6),
    "rad/s": ("turning rate", 1.0),
    "mrad/s": ("turning rate", 1e-3),
    "deg/s": ("turning rate", TURN / 360.0),
    "rev/s": ("turning rate", TURN),
    "rpm": ("turning rate", TURN / 60.0),
    "m/s": ("speed", 1.0),
    "mm/s": ("speed", 1e-3),
    "N m": ("torque", 1.0),
    "mN m": ("torque", 1e-3),
    "N cm": ("torque", 1e-2),
    "kN m": ("torque", 1e3),
    "kg cm": ("torque", 1e-2 * GRAVITY),
    "N": ("force", 1.0),
    "kN": ("force", 1e3),
    "kgf": ("force", GRAVITY),
    "m/s^2": ("acceleration", 1.0),
    "g": ("acceleration", GRAVITY),
    "mg": ("acceleration", 1e-3 * GRAVITY),
    "V": ("voltage", 1.0),
    "mV": ("voltage", 1e-3),
    "A": ("current", 1.0),
    "mA": ("current", 1e-3),
    "1": ("ratio", 1.0),
    "%": ("ratio", 1e-2),
    "count": ("counts", 1.0),
}
_SPELLINGS = {
    "nm": "N m", "n·m": "N m", "n.m": "N m", "n*m": "N m", "mnm": "mN m", "mn·m": "mN m",
    "°": "deg", "°/s": "deg/s", "degree": "deg", "degrees": "deg", "radian": "rad",
    "radians": "rad", "rads": "rad", "µs": "us", "μs": "us", "sec": "s", "secs": "s",
    "seconds": "s", "msec": "ms", "millis": "ms", "millisec": "ms", "milliseconds": "ms",
    "usec": "us", "micros": "us", "microseconds": "us", "nsec": "ns", "m/s²": "m/s^2",
    "m/s2": "m/s^2", "-": "1", "counts": "count", "ticks": "count", "bool": "1", "ratio": "1",
    "": "1", "volt": "V", "volts": "V", "ampere": "A", "amps": "A", "amp": "A", "ma": "mA",
    "kg": "kgf", "kg·cm": "kg cm", "n·cm": "N cm", "ncm": "N cm", "nmm": "mN m", "n·mm": "mN m",
    "kgcm": "kg cm", "µm": "um", "μm": "um", "deg/sec": "deg/s", "rad/sec": "rad/s",
    "degps": "deg/s", "dps": "deg/s", "radps": "rad/s", "rev/sec": "rev/s", "rps": "rev/s",
    "revs": "rev", "turns": "rev", "turns/s": "rev/s", "rotations": "rev", "revolutions": "rev",
}  # fmt: skip
_OPERATORS = {
    ast.Add: operator.add,
    ast.Sub: operator.sub,
    ast.Mult: operator.mul,
    ast.Div: operator.truediv,
    ast.Pow: operator.pow,
}


def unit(text: Any) -> str:
    """Canonical name of a unit in `UNITS`.

    Raises:
        NameUnknownError: The unit does not exist.
    """
    name = str(text).strip()
    symbol = name if name in UNITS else _SPELLINGS.get(name.lower(), name)
    if symbol not in UNITS:
        raise NameUnknownError("unit", name, UNITS)
    return symbol


def dimension(text: Any) -> str:
    """Quantity that a unit measures, e.g. angle."""
    return UNITS[unit(text)][0]


def factor(text: Any) -> float:
    """Size of a unit in the SI unit of its dimension."""
    return UNITS[unit(text)][1]


def number(value: Any, what: str) -> float:
    """A number, or an arithmetic expression of numbers and pi as text.

    Args:
        value: E.g. 0.5 or ``4096/2pi/(128*885)``; 2pi counts as one factor.
        what: Name of the value, for messages.

    Raises:
        ParameterError: The value is not a number.
    """
    if isinstance(value, (int, float)) and not isinstance(value, bool):
        result = float(value)
    else:
        text = re.sub(r"(\d(?:\.\d*)?)\s*pi\b", r"(\1*pi)", str(value))
        try:
            result = float(_evaluate(ast.parse(text, mode="eval").body))
        except (SyntaxError, ValueError, ZeroDivisionError, TypeError, OverflowError):
            raise ParameterError(
                f"{what} must be a number, or numbers and pi with + - * / ( ), got {value!r}"
            ) from None
    if not math.isfinite(result):
        raise ParameterError(f"{what} must be finite, got {value!r}")
    return result


def _evaluate(node: ast.AST) -> float:
    if isinstance(node, ast.Constant) and type(node.value) in (int, float):
        return float(node.value)
    if isinstance(node, ast.Name) and node.id == "pi":
        return math.pi
    if isinstance(node, ast.UnaryOp) and isinstance(node.op, (ast.USub, ast.UAdd)):
        value = _evaluate(node.operand)
        return -value if isinstance(node.op, ast.USub) else value
    if isinstance(node, ast.BinOp) and type(node.op) in _OPERATORS:
        return _OPERATORS[type(node.op)](_evaluate(node.left), _evaluate(node.right))
    raise ValueError("not a number")


def periodic(x: np.ndarray, period: float) -> np.ndarray:
    """Values without jumps of a period between neighbours, (K,)."""
    valid = np.isfinite(x)
    x = x.copy()
    x[valid] = np.unwrap(x[valid], period=period)
    return x
