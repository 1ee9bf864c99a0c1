# SPDX-License-Identifier: Apache-2.0
"""`loco reinforce`: learns, resumes, tells, refuses in one line, and its result runs on topics."""

from __future__ import annotations

import pytest

from loco_bringup.bag.reader import Bag
from loco_bringup.cli.main import main
from loco_bringup.graph import run as runner
from loco_bringup.record.readout_check import check_readout
from loco_bringup.record.verify import verify
from loco_learning.runs.experiment import load

pytestmark = pytest.mark.xdist_group("verify")  # one run of the command

SMALL = ["tigrillo_bound_reflex", *(word for key in ("train=4.0", "closing=2.0", "neurons=50")
                                    for word in ("--set", f"learner.{key}"))]  # fmt: skip
QUICK = [*SMALL, "--seconds", "30", "--batch", "2", "--episode", "1.5", "--lead", "1.5",
         "--workers", "0", "--test", "3"]  # fmt: skip


def run(*arguments):
    with pytest.raises(SystemExit) as ended:
        main(["reinforce", *map(str, arguments)])
    return ended.value.code


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Folder of a short run of the command."""
    out = tmp_path_factory.mktemp("reinforced") / "one"
    assert run(*QUICK, "--trials", 1, "--out", out) == 0
    return out


def test_it_tells_the_cost_before_and_compares_after(tmp_path, capsys):
    assert run(*QUICK, "--trials", 0, "--zero", "--out", tmp_path) == 0
    printed = capsys.readouterr().out
    assert "2 updates of 3 episodes, at most 28 s of simulated time" in printed
    assert "return " in printed and "reinforced.yaml" in printed
    assert "FORCE taught" not in printed


def test_the_page_has_curves_and_trials(folder):
    files = {path.name for path in folder.iterdir()}
    assert files == {
        "start.npz", "episodes.jsonl", "weights.npz", "reinforced.yaml", "reinforce.html"
    }  # fmt: skip
    page = (folder / "reinforce.html").read_text()
    for text in ("return [-]", "Cost of transport", "before", "bodies", "exploration"):
        assert text in page


def test_a_second_call_goes_on_to_the_same_end(folder):
    before = {p.name: p.read_bytes() for p in folder.iterdir() if p.suffix != ".html"}
    assert run(*QUICK, "--trials", 0, "--out", folder) == 0
    after = {p.name: p.read_bytes() for p in folder.iterdir() if p.suffix != ".html"}
    assert before["episodes.jsonl"] == after["episodes.jsonl"]
    assert before["reinforced.yaml"] == after["reinforced.yaml"]


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["tigrillo_bound"], "tigrillo_bound has no reflex network"),
        (["msd_20"], "msd_20 is of masses and springs"),
        ([*SMALL, "--seconds", "20"], "seconds is 20, but one update needs"),
        ([*SMALL, "--batch", "3"], "batch must be even"),
        ([*SMALL, "--zero", "--weights", "w.npz"], "exclude each other"),
        ([*SMALL, "--weights", "none.npz"], "none.npz"),
        ([*SMALL, "--trials", "x"], "invalid int value: 'x'"),
        ([*SMALL, "--push", "-1"], "push"),
    ],
)
def test_mistakes_are_refused_in_one_line(arguments, message, tmp_path, capsys):
    out = tmp_path / "out"
    assert run(*arguments, "--out", out) == 2
    said = capsys.readouterr().err.strip().splitlines()
    assert len(said) == 1 and message in said[0]
    assert not out.exists() or not list(out.iterdir())


def test_another_beginning_is_not_gone_on_with(folder, capsys):
    assert run(*QUICK, "--zero", "--out", folder) == 2
    assert "began with another readout; choose another --out" in capsys.readouterr().err
    assert run(*QUICK, "--seed", 1, "--out", folder) == 2
    assert "seed is 0 there, 1 here" in capsys.readouterr().err


@pytest.mark.ros
def test_the_result_drives_over_topics_and_its_bag_verifies(folder, tmp_path):
    experiment = load(folder / "reinforced.yaml")
    bag = tmp_path / "bag"
    outcome = runner.run(experiment, bag)
    assert not outcome.fallen and outcome.dropped == 0
    check = check_readout(bag)  # from the bag alone: the readout moves the joints
    assert len(check.t) == 299 and check.drives  # the first tick shows how it is
    verdict = verify(bag)
    assert verdict.identical, verdict.trouble
    assert verdict.ticks == Bag(bag).topics["/joint_command"].count
