# SPDX-License-Identifier: Apache-2.0
"""Parser of command-line values ``KEY=VALUE``."""

from __future__ import annotations

from typing import Any

from loco_control.exceptions import ParameterError
from loco_control.reading import parse_yaml, shown


def overrides(
    pairs: list[str],
    seed: int | None,
    engine: str | None = None,
    duration: float | None = None,
) -> dict[str, Any]:
    """Values of an experiment by dotted name, from ``--set`` and the options with these names."""
    values = values_of("--set", pairs, "gait.speed=0.3")
    options = {"seed": seed, "sim.engine": engine, "duration": duration}
    return merge({key: value for key, value in options.items() if value is not None}, values)


def merge(options: dict[str, Any], values: dict[str, Any]) -> dict[str, Any]:
    """Values of options and of ``--set`` together.

    Args:
        options: Values by name from dedicated options.
        values: Values by name from ``--set``.

    Raises:
        ParameterError: Both set the same value.
    """
    for key in sorted(options.keys() & values.keys()):
        raise ParameterError(
            f"{key} is given twice, {shown(options[key])} by an option of its own and "
            f"{shown(values[key])} by --set"
        )
    return options | values


def values_of(option: str, pairs: list[str], example: str) -> dict[str, Any]:
    """Values by name from ``KEY=VALUE`` texts; the value is YAML.

    Args:
        option: Name of the command-line option, for error messages.
        pairs: The texts.
        example: A valid text, for error messages.

    Raises:
        ParameterError: A text is not ``KEY=VALUE``, or a key is given twice.
    """
    values = {}
    for pair in pairs:
        key, equals, text = pair.partition("=")
        try:
            value = parse_yaml(text, option)
        except ParameterError:
            equals = ""
        if not equals or not key:
            raise ParameterError(f"{option} wants KEY=VALUE, e.g. {example}, got {pair!r}")
        if key in values:
            raise ParameterError(
                f"{option} {key} is given twice, {shown(values[key])} and {shown(value)}"
            )
        values[key] = value
    return values
