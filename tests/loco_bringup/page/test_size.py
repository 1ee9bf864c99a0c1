# SPDX-License-Identifier: Apache-2.0
"""Pages that grow with their data stay small enough to be sent by mail: under 3 MB."""

import dataclasses
import itertools

import numpy as np

from loco_bringup.gap import page as gap_page
from loco_bringup.logs.rollout_bag import run_rollout
from loco_bringup.report.report import write_report
from loco_bringup.study import page as study_page
from loco_learning.gap.localisation.curves import FIT, HELD_OUT, Curve, Curves
from loco_learning.runs.experiment import load
from loco_learning.study import study as studies

from ..gap.gap_result import result
from .test_browser import GRID, MOST


def test_a_report_whose_plots_are_full_with_its_animation(tmp_path):
    run_rollout(load("hyq_trot_open", {"duration": 20.0}), tmp_path, lambda _: None)
    size = write_report(tmp_path).stat().st_size
    assert 300_000 < size < MOST


def test_a_gap_of_twelve_joints_with_noise_in_every_value():
    rng, (samples, channels) = np.random.default_rng(1), (5000, 36)
    names = [(s, f"joint_{j}", u) for s, u in (("q", "rad"), ("dq", "rad/s"), ("tau", "N·m"))
             for j in range(channels // 3)]  # fmt: skip
    made = [
        Curve(f"record_{number}", role, np.arange(samples) / 250.0,
              *rng.normal(size=(3, samples, channels)), np.full((samples, channels), 0.1),
              np.full(samples, role == HELD_OUT), np.zeros(0))
        for number, role in enumerate((FIT, FIT, HELD_OUT, HELD_OUT))
    ]  # fmt: skip
    size = len(gap_page.page(result(), Curves(tuple(names), tuple(made))).encode())
    assert 300_000 < size < MOST


def test_the_maps_of_a_grid_as_large_as_that_of_chapter_7(tmp_path):
    """It has 60 x 60 cases; a page of 40 x 40 may have that share of the size."""
    (tmp_path / "mine.yaml").write_text(GRID)
    few = itertools.cycle(studies.run(studies.load(tmp_path / "mine.yaml"), tmp_path, 1))
    (tmp_path / "mine.yaml").write_text(GRID.replace(", 2], sets", ", 40], sets"))
    many = studies.load(tmp_path / "mine.yaml")
    cases = [dataclasses.replace(next(few), name=case.name) for case in many.cases()]
    size = study_page.write(many, cases, tmp_path).stat().st_size
    assert len(cases) == 1600 and 300_000 < size < MOST * 1600 / 3600
