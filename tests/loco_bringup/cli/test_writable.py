# SPDX-License-Identifier: Apache-2.0
"""Commands that work long say at once that their results could not be written."""

import pytest

from loco_bringup.cli.main import main

BAG = "tests/golden/hyq_open"
LONG = {
    "gap": ["gap", BAG, "--robot", "hyq"],
    "optimise": ["optimise", "tigrillo_bound"],
    "reinforce": ["reinforce", "tigrillo_bound_reflex"],
    "reinforce contest": ["reinforce", "contest"],
    "study": ["study", "open_loop"],
    "reproduce": ["reproduce", "all", "--quick"],
    "reproduce msd": ["reproduce", "msd", "--quick"],
    "battery": ["gap", "battery", "--cases", "1"],
    "fuzz": ["fuzz", "mapping"],
    "mutants": ["mutants"],
    "chaos": ["chaos"],
    "soak": ["soak"],
}


@pytest.mark.parametrize("name", LONG)
def test_it_is_refused_in_one_line_before_anything_runs(name, capsys):
    with pytest.raises(SystemExit) as ended:
        main([*LONG[name], "--out", "/proc/none"])
    said = capsys.readouterr().err.strip().splitlines()
    assert ended.value.code == 2
    assert len(said) == 1
    assert "/proc/none" in said[0]
