# SPDX-License-Identifier: Apache-2.0
"""Figures of the thesis show what made-up results of its studies hold."""

import numpy as np
import pytest

from loco_learning.drawing import png
from loco_learning.drawing.chart import DOTS
from loco_learning.study.case import CaseResult
from loco_learning.study.figures import VERDICT
from loco_learning.thesis import evidence, figures
from loco_learning.thesis.evidence import Evidence
from loco_learning.thesis.registry import NotRunError

PHASES = ("train", "closing", "test", "open", "trial")


class MadeUp(Evidence):
    """Cases of some entries of the quick plan, whose metrics are functions of variant and place."""

    def __init__(self, **values):
        super().__init__(evidence.plan("quick"), None)
        self._values = values

    def study(self, name):
        if name not in self._values:
            raise NotRunError(name)
        study = self.entries[name].load()
        return study, [self._case(study, case, self._values[name]) for case in study.cases()]

    def _case(self, study, case, value):
        metrics = dict.fromkeys(study.metrics, 0.1) | value(case.variant, case.at)
        verdict = dict.fromkeys(VERDICT, 0.0) | {"survived": True, "failed": [], "end": 15.0}
        return CaseResult(
            case.name, case.variant, case.seed, {}, verdict | {"fall": False},
            dict.fromkeys(PHASES, metrics), at=case.at,
        )  # fmt: skip


@pytest.fixture(scope="module")
def drawn():
    """Figures by name."""
    made = MadeUp(
        map=lambda variant, at: {"power": at["kp"]},
        stiffness=lambda variant, at: {"cost_of_transport": np.exp(at["kp"] / 500.0)},
        complexity=lambda variant, at: {"accuracy": at["M"] * (1 + 9 * (variant == "compliant"))},
    )
    return {name: (caption, chart) for name, caption, chart in figures.charts(made)}


def test_each_figure_whose_runs_are_there_is_drawn_with_its_caption(drawn, tmp_path):
    assert list(drawn) == ["figure_7_5", "figure_7_6", "figure_7_7"]  # terrain was not run
    for name, (caption, chart) in drawn.items():
        assert caption.startswith(name.replace("figure_", "Figure ").replace("7_", "7."))
        assert png.write(chart, tmp_path / f"{name}.png").stat().st_size > 10_000


def test_curves_over_stiffness_are_those_of_the_cases(drawn):
    frame = drawn["figure_7_6"][1].frames[0]
    means = [layer for layer in frame.layers if layer.shape != DOTS]
    assert {layer.name for layer in means} == {"open loop", "closed loop"}
    for layer in means:
        np.testing.assert_allclose(layer.y, np.exp(layer.x / 500.0))


def test_maps_of_both_robots_are_on_one_scale(drawn):
    compliant, stiff = drawn["figure_7_7"][1].frames
    colors = [{layer.name: layer.color for layer in f.layers} for f in (compliant, stiff)]
    assert colors[0] == colors[1]

    def values(frame):
        return sorted(float(t.split()[-1]) for layer in frame.layers for t in layer.texts)

    np.testing.assert_allclose(values(compliant), 10.0 * np.array(values(stiff)))


def test_the_regions_of_the_thesis_are_on_the_map(drawn):
    names = {layer.name.split(" (")[0] for layer in drawn["figure_7_5"][1].frames[0].layers}
    assert {"1 collapsed", "2 shaky", "3 underdamped", "4 overdamped", "5 good", "6 stiff"} <= names
