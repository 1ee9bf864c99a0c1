# SPDX-License-Identifier: Apache-2.0
"""Documentation pages generated from the registry of effects: an overview, a page per site."""

from __future__ import annotations

import dataclasses
import inspect
from collections.abc import Iterable
from typing import Any

from loco_sim import effects
from loco_sim.effects.identity import SITES

INTRO = """\
Departures of the plant from the ideal robot. An experiment lists them in order:
`effects: [{name: push, force: [0, 30, 0], start: 5, stop: 6}]`. Defaults are off, and an
effect that is off changes no byte. `joint` picks joints by name or pattern
(`"*_kfe_joint"`). Every effect also has `start` and `stop` [s]; those that are built into
the world are there from start to end. On a joint that slides read m for rad, N for N·m and
kg for kg·m².

*Prior*: nine of ten robots that have the effect lie between the outer numbers, the middle
one is typical; log-normal when all are above 0. *Enters*: where the effect enters the
plant (`command`, `drive`, `torque`, `brake`, `force`, `model`) or which sensor signal it changes.
*Passive*: it can never add energy to a robot that is not driven. *Smooth*: gradients may be
used. Figures: grey is the bare plant, orange the plant with the effect, in a fitting
experiment (`loco docs --figures` makes them anew, always the same).

Friction is a budget of torque to stop a joint. Below it a joint at rest stays at rest to
the last bit; a sliding joint is slowed by budget / inertia and never pushed back."""


def overview() -> list[str]:
    """Sections of the page that lists all effects, in order."""
    parts = [INTRO]
    for site in SITES:
        rows = "\n".join(f"| {_link(n)} | {_first_sentence(n)} |" for n in _names(site))
        parts.append(f"## {site.capitalize()}\n\n| effect | what it does |\n| --- | --- |\n{rows}")
    return parts


def page(site: str) -> list[str]:
    """Sections of the page about the effects of a site, in order."""
    return ["What the words mean stands in [effects](effects.md).", *map(_entry, _names(site))]


def _names(site: str) -> list[str]:
    return [name for name in effects.names() if _known(name).site == site]


def _known(name: str) -> Any:
    return effects.EFFECTS[name].identity


def _link(name: str) -> str:
    return f"[{name}](effects_{_known(name).site}.md#{name})"


def _first_sentence(name: str) -> str:
    return (
        inspect.cleandoc(effects.EFFECTS[name].__doc__ or "")
        .partition("\n\n")[0]
        .replace("\n", " ")
    )


def _entry(name: str) -> str:
    cls, identity = effects.EFFECTS[name], _known(name)
    facts = (
        f"Enters {', '.join(f'`{t}`' for t in identity.touches)}; "
        f"{'passive' if identity.passive else 'not passive'}, "
        f"{'smooth' if identity.smooth else 'not smooth'}"
        f"{', from start to end' if cls.lasting else ''}. "
        f"Source: {identity.source}."
    )
    similar = "\n".join(
        f"- looks like {_link(other.name)}: {other.experiment}" for other in identity.look_alikes
    )
    return "\n\n".join(
        (
            f"## {name}",
            f"![fingerprint of {name}](pictures/effects/{name}.png)",
            inspect.cleandoc(cls.__doc__ or ""),
            f"`{identity.equation}`. {facts}",
            _table(name),
            similar,
        )
    )


def _table(name: str) -> str:
    lines = ["| parameter | default | unit | range | prior | meaning |", "|" + " --- |" * 6]
    for f in dataclasses.fields(effects.EFFECTS[name]):
        if f.name not in ("start", "stop"):
            meta = f.metadata
            cells = (
                f"`{f.name}`",
                _default(f.default),
                meta["unit"],
                _range(meta),
                _prior(_known(name).priors.get(f.name)),
                meta["doc"],
            )
            lines.append("| " + " | ".join(c.replace("|", "\\|") for c in cells) + " |")
    return "\n".join(lines)


def _default(value: Any) -> str:
    if value == "":
        return "empty"
    return f"`{list(value) if isinstance(value, tuple) else value}`"


def _range(meta: Any) -> str:
    if meta.get("choices"):
        return ", ".join(f"`{c}`" for c in meta["choices"])
    low, high = meta.get("low"), meta.get("high")
    if low is None and high is None:
        return ""
    left = "(-inf" if low is None else f"[{low:g}"
    right = "inf)" if high is None else f"{high:g}]"
    return f"{left}, {right}"


def _prior(prior: Iterable[float] | None) -> str:
    return "" if prior is None else " · ".join(f"{value:g}" for value in prior)
