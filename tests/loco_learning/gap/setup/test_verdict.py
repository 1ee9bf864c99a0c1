# SPDX-License-Identifier: Apache-2.0
"""Lines that `gap check --fix` writes give the verdict of the recordings without the mistake."""

import pytest

from loco_learning.gap import workflow
from loco_learning.gap.params import GapParams

from .conftest import read
from .drawn import draw
from .machines import MACHINES

# One mistake of each kind that a pendulum with friction may have.
MISTAKES = {m.faults: m for m in draw(7, 80) if m.machine == "pendulum"}
PARAMS = GapParams(effects=("coulomb_friction", "viscous_friction", "payload"))


def verdict(model, records):
    found = workflow.find(model, records[:1], records[1:], PARAMS)
    return found["verdict"], found["names"]


@pytest.fixture(scope="module")
def clean(recorded, tmp_path_factory):
    folder = MACHINES["pendulum"].write(tmp_path_factory.mktemp("clean"), recorded("pendulum"))
    return verdict(*read(folder))


def test_every_kind_is_tried(clean):
    assert len(MISTAKES) >= 5
    assert clean == ("named", ["coulomb_friction"])


@pytest.mark.parametrize("mistake", MISTAKES.values(), ids=lambda m: m.text)
def test_the_lines_that_mend_give_the_verdict_of_the_clean_data(mistake, judged, mended, clean):
    findings = judged(mistake.machine, mistake.change, **mistake.robot)
    assert findings[0].stops
    assert verdict(*mended(findings)) == clean
