# SPDX-License-Identifier: Apache-2.0
"""A search begins and ends where the verdict says that there is or is no gap."""

from types import SimpleNamespace

import numpy as np
import pytest

from loco_learning.gap.fitting.search import Search
from loco_learning.gap.prediction.case import Case
from loco_learning.gap.verdict.decide import LIMITS, has_gap

ROWS, RECORDS = 500, 4


def whole(*levels):
    """Residuals whose one channel has these rms values, a record each."""
    signs = np.where(np.arange(ROWS) % 2, 1.0, -1.0)
    return [level * signs[:, None] for level in levels]


def explains(residuals):
    """Answer of a search whose last record judges."""
    flags = [np.full(ROWS, i < RECORDS - 1) for i in range(RECORDS)]
    case = SimpleNamespace(fit_rows=flags, held_rows=[~f for f in flags])
    case.masked = lambda *a: Case.masked(case, *a)
    return Search.adequate(SimpleNamespace(case=case), SimpleNamespace(whole=residuals))


@pytest.mark.parametrize("level", np.linspace(1.0, 2.0, 21))
def test_a_gap_that_the_verdict_sees_is_searched(level):
    """Between two thresholds a gap would end in unknown without a search."""
    residuals = whole(*[level] * RECORDS)
    if has_gap(residuals):
        assert not explains(residuals)
    assert explains(residuals) or level > LIMITS.explained


def test_what_is_left_in_the_record_that_judges_alone_is_searched():
    assert explains(whole(1.0, 1.0, 1.0, 1.0))
    assert not explains(whole(1.0, 1.0, 1.0, 1.8))
