# SPDX-License-Identifier: Apache-2.0
"""Drawn bodies and their calibrations: the draw, the errors, and the published table."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from loco_workshop import bodies

TABLE = Path(__file__).parents[2] / "docs" / "results" / "calibration_bodies.csv"


def test_bodies_are_within_the_prior_and_front_and_hind_are_independent():
    prior = bodies.Prior()
    drawn = [bodies.draw(seed)[0] for seed in range(200)]
    for what in bodies.PAIRS:
        low, high = getattr(prior, what)
        front, hind = (np.array([b[f"{what}_{end}"] for b in drawn]) for end in ("front", "hind"))
        assert low <= min(front.min(), hind.min()) and max(front.max(), hind.max()) <= high
        assert abs(np.corrcoef(np.log(front), np.log(hind))[0, 1]) < 0.2
        assert 0.4 < np.mean(hind > front) < 0.6  # no pattern is put in
    assert bodies.draw(3) == bodies.draw(3)


def row(**changes):
    """A table's row of a body that was found exactly."""
    true = {name: bodies.SET.default[name] for name in bodies.SET.names}
    found = {f"{name}_found": value for name, value in true.items()}
    return {"seed": 0.0, "before": 0.3, "after": 0.1, **true, **found, **changes}


def test_an_error_is_a_factor_whichever_is_larger():
    true = bodies.SET.default["stiffness_hind"]
    rows = [row(), row(stiffness_hind_found=2.0 * true), row(stiffness_hind_found=0.5 * true)]
    found, default = bodies.errors(rows, "stiffness_hind")
    assert found == pytest.approx([1.0, 2.0, 2.0]) and default == pytest.approx([1.0] * 3)
    share = bodies.SET.default["mass_share"]
    assert bodies.errors([row(mass_share_found=share - 0.1)], "mass_share")[0] == pytest.approx(0.1)


def test_the_page_has_the_table_that_is_shipped():
    rows = bodies.read(TABLE)
    assert len(rows) == len({r["seed"] for r in rows}) == 20
    for r in rows:
        body = bodies.draw(int(r["seed"]))[0]
        assert {name: r[name] for name in body} == pytest.approx(body, rel=1e-4)
    page = (TABLE.parents[1] / "calibration.md").read_text()
    printed = [line for line in bodies.summary(rows) if line.startswith("|")]
    assert [line for line in printed if line not in page] == []


def test_a_short_calibration_lowers_the_error(tmp_path):
    pytest.importorskip("pybullet"), pytest.importorskip("mujoco")
    model = tmp_path / "model.yaml"
    bodies.Model("tigrillo", {"sim.engine": "mujoco"}).save(model)
    one = bodies.calibrate(1, generations=1, seconds=20.0, model=model)
    assert one is not None and one["after"] < one["before"]
