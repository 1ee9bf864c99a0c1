# SPDX-License-Identifier: Apache-2.0
"""Maps of a grid: a metric as colour over two axes, what is good, and named regions."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import numpy as np

from ..metrics.registry import METRICS
from .case import CaseResult
from .figures import rows
from .grid import Axis, MapSpec

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

BOX = (0.17, 0.13, 0.57, 0.78)  # axes in a figure: left, bottom, width, height
KAPPA = "kappa"  # y / sqrt(x), which is proportional to the damping ratio
COLOURS = ("#6b7a8f", "#e0a458", "#c0392b", "#6a3d9a", "#2a7f4f", "#34568b", "#b5d99c", "#8cc5ea")


@dataclass(frozen=True)
class Sheet:
    """One plane of a grid: a variant, at one value of every axis beyond the two of the map.

    Attributes:
        title: Variant and those values.
        x: Axis to the right.
        y: Axis upwards.
        columns: Values by name, mean over seeds, (points of y, points of x) each.
        cases: Names of the cases at each point, (points of y, points of x).
    """

    title: str
    x: Axis
    y: Axis
    columns: dict[str, np.ndarray] = field(repr=False)
    cases: list[list[list[str]]] = field(repr=False)

    def within(self, ranges: dict[str, tuple[float, float]]) -> np.ndarray:
        """Points whose values are in all these ranges; NaN is in none, (ny, nx)."""
        inside = np.ones((len(self.y.values), len(self.x.values)), dtype=bool)
        for name, (low, high) in ranges.items():
            inside &= (self.columns[name] >= low) & (self.columns[name] <= high)
        return inside


@dataclass(frozen=True)
class Region:
    """A named part of the plane, and what was found there.

    Attributes:
        where: Points that belong to it by their place, (ny, nx).
        found: Points of `where` that behave as the rule says, (ny, nx).
        shares: Share of `where` that fulfils each condition.
    """

    where: np.ndarray = field(repr=False)
    found: np.ndarray = field(repr=False)
    shares: dict[str, float]

    @property
    def share(self) -> float:
        """Share of its points that behave as the rule says; NaN without a point."""
        return float(self.found.sum() / self.where.sum()) if self.where.any() else float("nan")


def sheets(study: Any, results: Sequence[CaseResult]) -> list[Sheet]:
    """Planes of a study with a map, from its results so far; points without one are NaN."""
    spec: MapSpec = study.map
    axes = {axis.name: axis for axis in study.axes}
    x, y = axes.pop(spec.x), axes.pop(spec.y)
    table = list(zip(rows(study, results), results, strict=True))
    made = []
    for variant, rest in itertools.product(
        study.variants, itertools.product(*(axis.values for axis in axes.values()))
    ):
        other = dict(zip(axes, rest, strict=True))
        own = [
            (row, case) for row, case in table
            if case.variant == variant and case.metrics
            and all(case.at[k] == v for k, v in other.items())
        ]  # fmt: skip
        if own:
            title = ", ".join([variant, *(f"{name} {value:g}" for name, value in other.items())])
            made.append(_sheet(title, x, y, own))
    return made


def _sheet(title: str, x: Axis, y: Axis, own: list[tuple[dict, CaseResult]]) -> Sheet:
    shape = len(y.values), len(x.values)
    names = [key for key, value in own[0][0].items() if isinstance(value, (bool, int, float))]
    gathered: list[list[list[dict]]] = [[[] for _ in x.values] for _ in y.values]
    cases: list[list[list[str]]] = [[[] for _ in x.values] for _ in y.values]
    column, line = ({v: i for i, v in enumerate(axis.values)} for axis in (x, y))
    for row, case in own:
        i, j = line[case.at[y.name]], column[case.at[x.name]]
        gathered[i][j].append(row)
        cases[i][j].append(case.name)
    columns = {name: np.full(shape, np.nan) for name in names}
    for (i, j), name in itertools.product(np.ndindex(shape), names):
        values = [row[name] for row in gathered[i][j]]
        if values:
            columns[name][i, j] = np.mean(values)
    grid_x, grid_y = np.meshgrid(x.values, y.values)
    columns |= {x.name: grid_x, y.name: grid_y}
    if grid_x.dtype.kind in "if" and grid_y.dtype.kind in "if":
        with np.errstate(all="ignore"):
            columns[KAPPA] = grid_y / np.sqrt(grid_x)
    return Sheet(title, x, y, columns, cases)


def regions(sheet: Sheet, spec: MapSpec) -> dict[str, Region]:
    """Regions of a sheet by the rules of its study: where they lie and what happens there."""
    made = {}
    for name, rule in spec.regions.items():
        where = sheet.within({**rule["where"], "survived": (0.0, 1.0)})  # was run at all
        what = rule["what"]
        found = where & sheet.within(what)
        shares = {
            key: float(sheet.within({key: ends})[where].mean()) if where.any() else float("nan")
            for key, ends in what.items()
        }
        made[name] = Region(where, found, shares)
    return made


# ---- drawing -----------------------------------------------------------------


def heat_map(sheet: Sheet, metric: str, spec: MapSpec) -> Figure:
    """A metric as colour; hatched where trials failed, a red edge around what is legal."""
    made, ax = _canvas(sheet)
    values = np.ma.masked_invalid(sheet.columns[metric])
    low, high = (np.percentile(values.compressed(), p) if values.count() else 0.0 for p in (2, 98))
    wide = low > 0.0 and high > 30.0 * low
    norm = _norm(low, high, wide)
    mesh = ax.pcolormesh(_edges(sheet.x), _edges(sheet.y), values, cmap="viridis", norm=norm)
    box = made.add_axes((BOX[0] + BOX[2] + 0.02, BOX[1], 0.025, BOX[3]))
    unit = METRICS[metric].unit if metric in METRICS else "-"
    made.colorbar(mesh, cax=box, label=f"{metric.replace('_', ' ')} [{unit}]", extend="both")
    failed = sheet.columns["survived"] < 0.5
    _hatch(ax, failed)
    if metric in spec.legal:
        _outline(ax, sheet.within({metric: spec.legal[metric]}), "#d62728")
    _damping_lines(ax, sheet, spec)
    return made


def region_map(sheet: Sheet, spec: MapSpec) -> Figure:
    """Regions: pale where the rule places them, full where the robot behaves as the rule says."""
    made, ax = _canvas(sheet)
    for k, (name, region) in enumerate(regions(sheet, spec).items()):
        colour = COLOURS[k % len(COLOURS)]
        for mask, alpha in ((region.where, 0.25), (region.found, 1.0)):
            shade = np.ma.masked_where(~mask, np.ones(mask.shape))
            ax.pcolormesh(
                _edges(sheet.x), _edges(sheet.y), shade, cmap=_flat(colour), alpha=alpha, lw=0
            )
        label = f"{name} ({region.share:.0%})" if region.where.any() else f"{name} (no point)"
        ax.plot([], [], "s", color=colour, label=label)
    _damping_lines(ax, sheet, spec)
    ax.legend(loc="upper left", bbox_to_anchor=(1.01, 1.0), frameon=False, fontsize=7)
    return made


def _canvas(sheet: Sheet) -> tuple[Figure, Axes]:
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    made = Figure(figsize=(6.4, 4.6), dpi=120)
    FigureCanvasAgg(made)
    ax = made.add_axes(BOX)
    for axis, set_ticks, label in (
        (sheet.x, ax.set_xticks, ax.set_xlabel), (sheet.y, ax.set_yticks, ax.set_ylabel),
    ):  # fmt: skip
        count = len(axis.values)
        shown = np.unique(np.linspace(0, count - 1, min(count, 5)).round().astype(int))
        set_ticks(shown, [f"{axis.values[i]:.3g}" for i in shown])
        label(f"{axis.name} [{axis.unit}]" if axis.unit else axis.name)
    ax.set_title(sheet.title, fontsize=9)
    return made, ax


def _edges(axis: Axis) -> np.ndarray:
    """Cells are of equal size, in the order of the values."""
    return np.arange(len(axis.values) + 1) - 0.5


def _norm(low: float, high: float, wide: bool) -> Any:
    from matplotlib.colors import LogNorm, Normalize

    return LogNorm(low, high) if wide else Normalize(low, high if high > low else low + 1.0)


def _flat(colour: str) -> Any:
    from matplotlib.colors import ListedColormap

    return ListedColormap([colour])


def _hatch(ax: Axes, mask: np.ndarray) -> None:
    """Hatch the cells of a mask."""
    from matplotlib.collections import PatchCollection
    from matplotlib.patches import Rectangle

    cells = [Rectangle((j - 0.5, i - 0.5), 1.0, 1.0) for i, j in np.argwhere(mask)]
    look = {"facecolor": "none", "edgecolor": "white", "hatch": "////", "linewidth": 0.0}
    ax.add_collection(PatchCollection(cells, **look))


def _outline(ax: Axes, mask: np.ndarray, colour: str) -> None:
    """Edge around the cells of a mask, along their sides."""
    from matplotlib.collections import LineCollection

    padded = np.pad(mask, 1)
    sides = [
        ([(j - 1.5, i - 1.5), (j - 0.5, i - 1.5)])
        for i, j in np.argwhere(padded[1:, :] != padded[:-1, :]) + (1, 0)
    ]
    sides += [
        ([(j - 1.5, i - 1.5), (j - 1.5, i - 0.5)])
        for i, j in np.argwhere(padded[:, 1:] != padded[:, :-1]) + (0, 1)
    ]
    ax.add_collection(LineCollection(sides, colors=colour, linewidths=1.6))


def _damping_lines(ax: Axes, sheet: Sheet, spec: MapSpec) -> None:
    """Lines y = kappa sqrt(x), along which the damping ratio is the same."""
    if not (sheet.x.logarithmic and sheet.y.logarithmic):
        return
    x, y = (np.log10(np.asarray(axis.values, dtype=float)) for axis in (sheet.x, sheet.y))
    for kappa in spec.iso_damping:
        at = np.interp(np.log10(kappa) + 0.5 * x, y, np.arange(len(y)), np.nan, np.nan)
        ax.plot(np.arange(len(x)), at, color="black", lw=1.4, alpha=0.5)
        ax.plot(np.arange(len(x)), at, color="white", lw=0.8, ls=(0, (4, 3)))
        seen = np.flatnonzero(np.isfinite(at))
        if len(seen):
            box = {"fc": "white", "lw": 0, "pad": 0.8}
            at_end = (seen[-1], at[seen[-1]])
            ax.annotate(f"κ {kappa:g}", at_end, fontsize=6.5, ha="right", va="bottom", bbox=box)
    ax.set(xlim=(-0.5, len(x) - 0.5), ylim=(-0.5, len(y) - 0.5))
