# SPDX-License-Identifier: Apache-2.0
"""Lines that `gap check --fix` writes give the verdict of the recordings without the mistake."""

import pytest

from loco_learning.gap import workflow
from loco_learning.gap.fitting.params import GapParams

from .conftest import read
from .drawn import draw
from .machines import MACHINES

# One mistake of each kind that a pendulum with friction may have.
MISTAKES = {m.faults: m for m in draw(7, 80) if m.machine == "pendulum"}
RUBS = {"friction": 0.3}  # as large as it has to be for a name in 16 s of a pendulum
PARAMS = GapParams(effects=("coulomb_friction", "viscous_friction", "payload"))


def verdict(model, records):
    found = workflow.find(model, records[:1], records[1:], PARAMS)
    return found["verdict"], found["names"], found["ambiguous"]


@pytest.fixture(scope="module")
def clean(recorded, tmp_path_factory):
    folder = MACHINES["pendulum"].write(tmp_path_factory.mktemp("clean"), recorded("pendulum", **RUBS))
    return verdict(*read(folder))


def test_every_kind_is_tried(clean):
    assert len(MISTAKES) >= 5
    assert clean == ("named", ["coulomb_friction"], [])


@pytest.mark.parametrize("mistake", MISTAKES.values(), ids=lambda m: m.text)
def test_the_lines_that_mend_give_the_verdict_of_the_clean_data(mistake, judged, mended, clean):
    robot = {**mistake.robot, "about": {**RUBS, **mistake.robot.get("about", {})}}
    findings = judged(mistake.machine, mistake.change, **robot)
    assert findings[0].stops
    found = verdict(*mended(findings))
    if "about" in mistake.robot:  # another motion, which may tell less
        assert any("coulomb_friction" in names for names in (found[1], *found[2]))
    else:
        assert found == clean
