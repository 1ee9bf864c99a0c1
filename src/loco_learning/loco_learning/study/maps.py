# SPDX-License-Identifier: Apache-2.0
"""Maps of a grid: a metric as colour over two axes, permitted ranges, and named regions."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ..drawing import heat
from ..drawing.chart import DASHED, Chart, Frame, Layer, dots, line
from ..drawing.chart import Axis as Scale
from ..metrics.registry import METRICS
from .case import CaseResult
from .figures import rows
from .grid import Axis, MapSpec

KAPPA = "kappa"  # y / sqrt(x), which is proportional to the damping ratio
# Saturated and pale colours of regions.
COLOURS = (
    ("#0072b2", "#b9d7ea"), ("#d55e00", "#f3cdb0"), ("#009e73", "#b5dfd2"), ("#cc79a7", "#efd5e3"),
    ("#a07000", "#e6d6ac"), ("#56b4e9", "#cfe8f8"), ("#5b3a8c", "#d0c5e0"), ("#6b7a8f", "#d5d9df"),
)  # fmt: skip
BLACK, OUTLINE = "#222222", "#d62728"


@dataclass(frozen=True)
class Sheet:
    """One plane of a grid: a variant, at one value of every axis that is not in the map.

    Attributes:
        title: Variant and values of the other axes.
        x: Horizontal axis.
        y: Vertical axis.
        columns: Values by name, mean over seeds, (points of y, points of x) each.
        cases: Names of the cases at each point, (points of y, points of x).
    """

    title: str
    x: Axis
    y: Axis
    columns: dict[str, np.ndarray] = field(repr=False)
    cases: list[list[list[str]]] = field(repr=False)

    def within(self, ranges: dict[str, tuple[float, float]]) -> np.ndarray:
        """Flags of points with values in all these ranges, (ny, nx); NaN is in none."""
        inside = np.ones((len(self.y.values), len(self.x.values)), dtype=bool)
        for name, (low, high) in ranges.items():
            inside &= (self.columns[name] >= low) & (self.columns[name] <= high)
        return inside


@dataclass(frozen=True)
class Region:
    """A named part of the plane, with the behaviour of the robot in it.

    Attributes:
        where: Flags of the points that belong to it by definition, (ny, nx).
        found: Flags of the points of `where` with the behaviour of the rule, (ny, nx).
        shares: Share of `where` that satisfies each condition.
    """

    where: np.ndarray = field(repr=False)
    found: np.ndarray = field(repr=False)
    shares: dict[str, float]

    @property
    def share(self) -> float:
        """Share of its points with the behaviour of the rule; NaN without a point."""
        return float(self.found.sum() / self.where.sum()) if self.where.any() else float("nan")


def sheets(study: Any, results: Sequence[CaseResult]) -> list[Sheet]:
    """Planes of a study's map, from the results so far; points without a result are NaN."""
    spec: MapSpec = study.map
    axes = {axis.name: axis for axis in study.axes}
    x, y = axes.pop(spec.x), axes.pop(spec.y)
    table = list(zip(rows(study, results), results, strict=True))
    sheet_list = []
    for variant, settings in itertools.product(
        study.variants, itertools.product(*(axis.values for axis in axes.values()))
    ):
        other = dict(zip(axes, settings, strict=True))
        selected = [
            (row, case) for row, case in table
            if case.variant == variant and case.metrics
            and all(case.at[k] == v for k, v in other.items())
        ]  # fmt: skip
        if selected:
            title = ", ".join([variant, *(f"{name} {value:g}" for name, value in other.items())])
            sheet_list.append(_sheet(title, x, y, selected))
    return sheet_list


def _sheet(title: str, x: Axis, y: Axis, rows: list[tuple[dict, CaseResult]]) -> Sheet:
    shape = len(y.values), len(x.values)
    names = [key for key, value in rows[0][0].items() if isinstance(value, (bool, int, float))]
    gathered: list[list[list[dict]]] = [[[] for _ in x.values] for _ in y.values]
    cases: list[list[list[str]]] = [[[] for _ in x.values] for _ in y.values]
    column, line = ({v: i for i, v in enumerate(axis.values)} for axis in (x, y))
    for row, case in rows:
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
    """Regions of a sheet by the rules of its study: location and behaviour."""
    masks = {}
    for name, rule in spec.regions.items():
        where = sheet.within({**rule["where"], "survived": (0.0, 1.0)})  # has a result
        what = rule["what"]
        mask = where & sheet.within(what)
        shares = {
            key: float(sheet.within({key: limits})[where].mean()) if where.any() else float("nan")
            for key, limits in what.items()
        }
        masks[name] = Region(where, mask, shares)
    return masks


# ---- drawing -----------------------------------------------------------------


def heat_map(sheet: Sheet, metric: str, spec: MapSpec) -> Chart:
    """A metric as colour, with dots for failed trials and an outline of the permitted range.

    Args:
        sheet: The plane.
        metric: Name of the metric.
        spec: The map's settings.
    """
    unit = METRICS[metric].unit if metric in METRICS else "-"
    layers = heat.cells(sheet.columns[metric], unit, _links(sheet), metric.replace("_", " "))
    failed = np.argwhere(sheet.columns["survived"] < 0.5).reshape(-1, 2)
    layers += heat.haloed(dots("failed", failed[:, 1], failed[:, 0], BLACK, size=2.0))
    if metric in spec.legal:
        legal = sheet.within({metric: spec.legal[metric]})
        layers.append(heat.outline(legal, "edge of the legal range", OUTLINE))
    return _plane(sheet, [*layers, *_damping_lines(sheet, spec)])


def region_map(sheet: Sheet, spec: MapSpec, page: str = "") -> Chart:
    """Regions: pale by definition, saturated where the robot has the behaviour of the rule.

    Args:
        sheet: The plane.
        spec: The map's settings.
        page: Page to which the cells link, relative to the page of the map; empty for that page.
    """
    layers = []
    for k, (name, region) in enumerate(regions(sheet, spec).items()):
        full, pale = COLOURS[k % len(COLOURS)]
        label = f"{name} ({region.share:.0%})" if region.where.any() else f"{name} (no point)"
        for mask, colour, what in (
            (region.where & ~region.found, pale, "as placed, not as it behaves"),
            (region.found, full, "as it behaves"),
        ):
            labels = [f"{name}: {what}"] * int(mask.sum())
            layers.append(heat.marked(mask, label, colour, _links(sheet, page), labels))
    return _plane(sheet, [*layers, *_damping_lines(sheet, spec)])


def _links(sheet: Sheet, page: str = "") -> list[list[str]]:
    """Link to the first case of each cell."""
    return [[f"{page}#case-{names[0]}" if names else "" for names in row] for row in sheet.cases]


def _plane(sheet: Sheet, layers: list[Layer]) -> Chart:
    """Layers on the axes of a sheet, with cells of equal size in the order of the values."""
    x, y = (
        Scale(axis.label,
             names=[f"{float(f'{value:.3g}'):g}" if isinstance(value, float) else str(value)
                    for value in axis.values])
        for axis in (sheet.x, sheet.y)
    )  # fmt: skip
    return Chart([Frame(x, y, layers, sheet.title, height=420)])


def _damping_lines(sheet: Sheet, spec: MapSpec) -> list[Layer]:
    """Lines y = kappa sqrt(x) of constant damping ratio."""
    if not (sheet.x.logarithmic and sheet.y.logarithmic):
        return []
    x, y = (np.log10(np.asarray(axis.values, dtype=float)) for axis in (sheet.x, sheet.y))
    positions = np.arange(len(x))
    lines = []
    for kappa in spec.iso_damping:
        at = np.interp(np.log10(kappa) + 0.5 * x, y, np.arange(len(y)), np.nan, np.nan)
        lines += heat.haloed(line(f"κ {kappa:g}", positions, at, BLACK, shape=DASHED, size=1.2))
    return lines
