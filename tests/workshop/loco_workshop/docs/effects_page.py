# SPDX-License-Identifier: Apache-2.0
"""Documentation pages generated from the registry of effects: an overview, a page per site."""

from __future__ import annotations

import dataclasses
import inspect
from collections.abc import Iterable
from typing import Any

from loco_sim import effects
from loco_sim.effects.identity import SITES, LookAlike

INTRO = """\
An effect is a deviation of the simulated robot from the ideal one. An experiment lists effects in
order: `effects: [{name: push, force: [0, 30, 0], start: 5, stop: 6}]`. The default of an effect is
off; it then changes no byte.

![A joint without backlash and with it](pictures/effects/backlash.png)

How to read the entries:

- *Parameters*: effects on joints also have `joint`, a name or pattern such as `"*_kfe_joint"`;
  without it they act on all joints to which they apply. Every effect has `start` and `stop` [s].
  Effects *from start to end* are built into the world and act during the whole run. For sliding
  joints the units are m instead of rad, N instead of N·m and kg instead of kg·m².
- *Prior*: nine of ten robots with the effect have a value between the outer numbers; the middle
  number is typical. The distribution is log-normal if all numbers are above 0.
- *Enters*: the part of the plant in which the effect acts (`command`, `drive`, `torque`, `brake`,
  `force`, `model`), or the sensor signals that it changes.
- *Passive*: the effect can never add energy to a robot without drives. *Smooth*: its derivatives
  may be used by an optimiser.
- *Similar to*: another effect that can cause the same data, with an experiment that separates both
  and its result.
- Pictures: a fitting experiment without the effect (grey) and with it (orange).
  `loco docs --figures` draws them again.

A friction effect is a largest torque that acts against the motion. A joint at rest stays at rest
while the other torques are smaller. A moving joint is slowed down, and its direction is never
reversed."""


def overview() -> list[str]:
    """Sections of the page that lists all effects, in order."""
    parts = [INTRO]
    for site in SITES:
        rows = "\n".join(f"| {_link(n)} | {_first_sentence(n)} |" for n in _names(site))
        parts.append(f"## {site.capitalize()}\n\n| effect | description |\n| --- | --- |\n{rows}")
    return parts


def page(site: str) -> list[str]:
    """Sections of the page about the effects of a site, in order."""
    return ["[Effects](effects.md) explains the entries.", *map(_entry, _names(site))]


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
        f"{', from start to end' if cls.lasting else ''}"
        f"{'; acts on `joint`' if 'joint' in _fields(cls) else ''}. "
        f"Source: {identity.source}."
    )
    similar = "\n".join(map(_similar, identity.look_alikes))
    return "\n\n".join(
        (
            f"## {name}\n![fingerprint of {name}](pictures/effects/{name}.png)",
            inspect.cleandoc(cls.__doc__ or ""),
            f"`{identity.equation}`. {facts}",
            _table(name),
            similar,
        )
    )


def _similar(other: LookAlike) -> str:
    motion, *differs = other.experiment.split(": ", 1)
    told = f"{motion}; there {differs[0]}" if differs else motion
    return f"- Similar to {_link(other.name)}. An experiment that separates them: {told}."


def _table(name: str) -> str:
    lines = ["| parameter | default | unit | range | prior | meaning |", "|" + " --- |" * 6]
    for f in dataclasses.fields(effects.EFFECTS[name]):
        if f.name not in ("joint", "start", "stop"):
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


def _fields(cls: Any) -> set[str]:
    return {f.name for f in dataclasses.fields(cls)}


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
