# SPDX-License-Identifier: Apache-2.0
"""Mistakes drawn by a seed: at least 95 % are found, alone and at the right joint, and mended."""

import pytest

from loco_learning.gap.setup import family
from loco_learning.gap.setup.bench import Bench

from .drawn import draw
from .machines import MACHINES

COUNT, SEED = 25, 7  # so many that each machine is drawn three times


@pytest.fixture
def outcome(judged, mended):
    """Function that says what is wrong with what is found of a mistake; "" for nothing."""

    def make(mistake):
        findings = judged(mistake.machine, mistake.change, **mistake.robot)
        if len(findings) != 1 or findings[0].fault not in mistake.faults:
            return "; ".join(map(str, findings)) or "nothing found"
        if not set(mistake.joints) <= set(findings[0].joints):
            return f"found at {findings[0].joints}"
        if not findings[0].mends:
            return "" if findings[0].fault == "ahead" else "no line"
        model, records = mended(findings)
        again = family.find_mistakes(model, records)
        if again or Bench(model, records).miss() > 0.1:
            return f"not mended: {'; '.join(map(str, again))}"
        return ""

    return make


@pytest.mark.parametrize("machine", MACHINES)
def test_every_machine_and_several_kinds_are_drawn(machine):
    drawn = draw(SEED, COUNT)
    assert sum(m.machine == machine for m in drawn) >= 3
    assert len({m.faults for m in drawn}) >= 7


def test_nineteen_of_twenty_mistakes_are_found_at_their_joint_and_their_lines_mend_them(outcome):
    wrong = {f"{m.machine}: {m.text}": outcome(m) for m in draw(SEED, COUNT)}
    wrong = {text: why for text, why in wrong.items() if why}
    assert len(wrong) <= 0.05 * COUNT, wrong
