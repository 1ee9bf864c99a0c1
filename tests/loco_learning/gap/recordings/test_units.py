# SPDX-License-Identifier: Apache-2.0
"""Units and numbers as people write them."""

import math

import pytest

from loco_control.exceptions import NameUnknownError, ParameterError
from loco_learning.gap.recordings import units


def test_units_convert():
    assert 360 * units.factor("deg") == pytest.approx(units.factor("rev"))
    assert 60 * units.factor("rpm") == pytest.approx(units.factor("rev/s"))
    assert units.factor("ms") == 1e-3 and units.factor("mN m") == 1e-3


def test_spellings_are_understood():
    assert units.unit("N·m") == units.unit("Nm") == units.unit("N m")
    assert units.unit("°") == "deg" and units.dimension("m/s²") == "acceleration"


def test_every_spelling_leads_to_a_unit():
    assert set(units._SPELLINGS.values()) <= set(units.UNITS)


def test_an_unknown_unit_lists_the_known():
    with pytest.raises(NameUnknownError, match="did you mean 'deg'"):
        units.unit("dge")


@pytest.mark.parametrize(
    ("text", "value"),
    [
        (0.5, 0.5),
        ("1/7.4", 1 / 7.4),
        ("2pi/4096", 2 * math.pi / 4096),
        ("4096/2pi/(128*885)", 4096 / (2 * math.pi) / (128 * 885)),
        ("-pi", -math.pi),
        ("1e7/2**14", 610.3515625),
    ],
)
def test_numbers_are_worked_out(text, value):
    assert units.number(text, "x") == pytest.approx(value)


@pytest.mark.parametrize("text", ["abc", "1/0", "__import__('os')", "", True, "1e999", None, "2*q"])
def test_other_texts_are_refused(text):
    with pytest.raises(ParameterError, match="scale"):
        units.number(text, "scale")
