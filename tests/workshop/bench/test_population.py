# SPDX-License-Identifier: Apache-2.0
"""The bench of the population engine measures what it says; no test looks at a time."""

import pytest

from loco_workshop.bench.population import Busy, measure


def test_a_row_holds_three_speeds_and_what_follows():
    row = measure("busy", Busy(0.001), 40)
    assert row.problem == "busy"
    assert min(row.loop, row.here, row.two) > 0.0
    assert row.overhead == pytest.approx(1e3 / row.here - 1e3 / row.loop)
    assert row.efficiency == pytest.approx(row.two / row.loop / 2.0)
