# SPDX-License-Identifier: Apache-2.0
"""Every study that is shipped: its tables and maps can be made of results."""

from importlib import resources

import pytest

from loco_learning.study import figures, maps
from loco_learning.study.case import CaseResult
from loco_learning.study.study import load

STUDIES = sorted(
    path.name.removesuffix(".yaml")
    for path in resources.files("loco_learning").joinpath("studies").iterdir()
    if path.name.endswith(".yaml")
)
VERDICT = {"survived": True, "failed": [], "end": 1.0, **dict.fromkeys(figures.VERDICT, 0.5)}


def results(study):
    """A case of each variant at both ends of the grid, with numbers for all metrics."""
    cases = {}
    for case in study.cases():
        cases.setdefault((case.variant, "first"), case)
        cases[case.variant, "last"] = case
    metrics = {study.phase: dict.fromkeys(study.metrics, 1.0)}
    return [
        CaseResult(case.name, case.variant, case.seed, {}, VERDICT, metrics, at=case.at)
        for case in cases.values()
    ]


@pytest.mark.parametrize("name", STUDIES)
def test_a_study_that_is_shipped_has_its_table_and_its_maps(name):
    study = load(name)
    made = results(study)
    assert len(figures.as_csv(study, made).splitlines()) == len(made) + 1
    sheets = maps.sheets(study, made) if study.map else []
    for sheet in sheets:
        assert sheet.columns[study.map.x].dtype.kind in "if"
        assert maps.heat_map(sheet, study.map.metrics[0], study.map)
    assert bool(sheets) == bool(study.map)
