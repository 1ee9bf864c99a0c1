# SPDX-License-Identifier: Apache-2.0
"""Measured signals, and the model before and after: the arrays beside gap.json."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from loco_control.exceptions import BagError, LocoError
from loco_control.files import write_whole
from loco_control.reading import parse_json, read_npz

FIT, HELD_OUT = "fit", "held-out"
LASTING = 0.99  # share of the time of which the rest is an instant


@dataclass(frozen=True)
class Curve:
    """One record.

    Attributes:
        name: Name of the record.
        role: `FIT` or `HELD_OUT`.
        t: Times [s], (T,).
        measured: One column per channel, (T, C); NaN where nothing was measured.
        before: The model as given says this, (T, C).
        after: The model that was found says this, (T, C).
    """

    name: str
    role: str
    t: np.ndarray
    measured: np.ndarray
    before: np.ndarray
    after: np.ndarray

    def residual(self, which: str) -> np.ndarray:
        """Measured minus ``before`` or ``after``, (T, C)."""
        return self.measured - getattr(self, which)


@dataclass(frozen=True)
class Curves:
    """All records of a search.

    Attributes:
        channels: Signal, name (of the joint, axis or foot) and unit of each column.
        floor: Noise of each channel, measurement and numerics together [unit], (C,).
        records: The curves.
    """

    channels: tuple[tuple[str, str, str], ...]
    floor: np.ndarray
    records: tuple[Curve, ...]

    def of_role(self, role: str) -> list[Curve]:
        """Records of a role; all if there are none."""
        return [r for r in self.records if r.role == role] or list(self.records)

    def rms(self, which: str, role: str = HELD_OUT) -> np.ndarray:
        """Root mean square of the residual of each channel [unit], (C,); NaN where unknown."""
        stacked = np.concatenate([r.residual(which) for r in self.of_role(role)])
        known = np.isfinite(stacked)
        total = np.sum(np.where(known, stacked, 0.0) ** 2, axis=0)
        count = known.sum(axis=0)
        return np.sqrt(np.divide(total, count, out=np.full(len(total), np.nan), where=count > 0))

    def worst(self, count: int) -> list[int]:
        """Columns with the largest gap before, in units of their floor, in their order.

        What lasts an instant, such as a start that is a little off, is nothing to look at.
        """
        miss = np.abs(np.concatenate([r.residual("before") for r in self.of_role(HELD_OUT)]))
        miss = np.where(np.isfinite(miss).any(axis=0), np.nan_to_num(miss), -1.0)
        lasting = np.minimum(miss, np.quantile(miss, LASTING, axis=0))
        ratio = np.mean(lasting * np.abs(lasting), axis=0) / np.maximum(self.floor, 1e-30) ** 2
        return sorted(np.argsort(-ratio, kind="stable")[:count].tolist())

    def label(self, column: int) -> str:
        """Name of a column for people."""
        signal, name, _ = self.channels[column]
        return f"{signal} {name.removesuffix('_joint')}".replace("_", " ").strip()

    def unit(self, column: int) -> str:
        """Unit of a column."""
        return self.channels[column][2]

    def save(self, path: str | Path) -> None:
        """Write an .npz, whole or not at all."""
        heads = [{"name": r.name, "role": r.role} for r in self.records]
        arrays = {"floor": self.floor, "head": json.dumps([list(map(list, self.channels)), heads])}
        for i, r in enumerate(self.records):
            for key in ("t", "measured", "before", "after"):
                kind = np.float64 if key == "t" else np.float32
                arrays[f"{key}_{i}"] = getattr(r, key).astype(kind)
        write_whole(path, lambda file: np.savez_compressed(file, **arrays))


def load(path: str | Path) -> Curves:
    """Read what `Curves.save` wrote.

    Raises:
        BagError: It is no such file.
    """
    try:
        file = read_npz(path)
        channels, heads = parse_json(str(file["head"]), path)
        records = tuple(
            Curve(
                h["name"], h["role"], file[f"t_{i}"],
                *(file[f"{key}_{i}"].astype(float) for key in ("measured", "before", "after")),
            )
            for i, h in enumerate(heads)
        )  # fmt: skip
        return Curves(tuple(map(tuple, channels)), file["floor"], records)
    except (LocoError, KeyError, ValueError, TypeError) as error:
        raise BagError(f"{path} does not hold the curves of a gap ({error})") from None


def curves(before, after, records: Sequence, roles: Sequence[str], floor: np.ndarray) -> Curves:
    """Curves of two models.

    Args:
        before: `Forward` of the model as given.
        after: `Forward` of the model that was found.
        records: Their records.
        roles: Role of each.
        floor: Noise of each channel, (C,).
    """
    rows = zip(records, roles, before.measured, before(), after(), strict=True)
    channels = tuple((c.signal, c.name, c.unit) for c in before.channels)
    return Curves(
        channels,
        np.asarray(floor, dtype=float),
        tuple(Curve(r.name, role, r.t[: len(m)], m, b, a) for r, role, m, b, a in rows),
    )
