# SPDX-License-Identifier: Apache-2.0
"""A module with a test that sees one of its lines: the mutants of the other line survive."""

import json
import os
import py_compile
from pathlib import Path

import pytest

from loco_bringup.cli.main import main
from loco_control.exceptions import LocoError
from loco_control.files import write_whole
from loco_learning.jobs.journal import Journal
from loco_workshop.mutants import run, terminal
from loco_workshop.reliability import figures

ROOT = Path(__file__).resolve().parents[3]
MODULE, TESTS = "src/guarded/__init__.py", ("tests/test_guarded.py",)
SOURCE = "def seen(x):\n    return x + 1\n\n\ndef unseen(x):\n    return x < 3\n"
TEST = """
import guarded


def test_seen():
    assert guarded.seen(1) == 2
"""


@pytest.fixture
def clone(tmp_path, monkeypatch):
    for path, text in ((MODULE, SOURCE), (TESTS[0], TEST), ("pyproject.toml", "")):
        write_whole(tmp_path / path, text)
    monkeypatch.setattr(run, "PROTECTING", {MODULE: TESTS})
    monkeypatch.setenv("PYTHONPATH", str(tmp_path / "src"), prepend=os.pathsep)
    return tmp_path


def survey(clone, limit=0, survivors=False, by_hand=False):
    """Verdicts, and how many of them are not from an earlier survey."""
    journal = Journal(clone / "out/mutants.jsonl", {"kind": "mutants"})
    told, known = [], len(journal.rows)
    verdicts = run.survey(clone, [MODULE], limit, 0, 2, journal, told.append, survivors, by_hand)
    journal.close()
    assert told == verdicts
    return verdicts, len(journal.rows) - known


def ends(verdicts):
    return {v.change.split(":")[0] + " " + v.end for v in verdicts}


def test_what_no_test_sees_survives_and_a_survey_goes_on(clone, tmp_path):
    verdicts, new = survey(clone, limit=2)
    assert new == len(verdicts) == 2
    verdicts, new = survey(clone)
    assert new == len(verdicts) - 2 > 0
    assert ends(verdicts) == {"seen killed", "unseen survived"}
    assert 0.0 < run.score(verdicts) < 1.0
    run.write(verdicts, tmp_path / "out")
    assert "unseen: x < 3 -> x <= 3" in (tmp_path / "out" / "mutants.md").read_text()


def test_a_draw_is_from_all_modules_together_and_its_figure_is_no_modules(
    clone, monkeypatch, capsys
):
    other = "src/guarded/other.py"
    write_whole(clone / other, SOURCE)
    monkeypatch.setattr(run, "PROTECTING", {MODULE: TESTS, other: TESTS})
    monkeypatch.setattr(terminal, "PROTECTING", run.PROTECTING)
    monkeypatch.setattr(terminal, "root", lambda: clone)
    out = clone / "out"
    with pytest.raises(SystemExit):
        main(["mutants", "--only", "guarded", "--limit", "3", "--out", str(out)])
    (figure,) = figures.read(out / figures.NAME)
    assert (figure.subject, figure.part, figure.values["mutants"]) == (
        "mutants drawn",
        "guarded",
        3,
    )
    assert len({v["module"] for v in json.loads((out / "mutants.json").read_text())}) == 2


def test_mutants_made_by_hand_stand_beside_the_others_or_alone(clone, monkeypatch):
    made = {"it adds two": ["x + 1", "x + 2"], "it is larger": ["x < 3", "x > 3", "nobody asks"]}
    monkeypatch.setattr(run, "BY_HAND", {MODULE: made})
    verdicts, _ = survey(clone, by_hand=True)
    ends = {v.change: v.end for v in verdicts}
    assert ends == {"by hand: it adds two": "killed", "by hand: it is larger": "survived"}
    assert len(survey(clone)[0]) > len(verdicts)


def test_byte_code_of_the_original_never_stands_for_a_mutant(clone):
    always = py_compile.PycInvalidationMode.UNCHECKED_HASH
    py_compile.compile(str(clone / MODULE), invalidation_mode=always)
    assert "seen killed" in ends(survey(clone)[0])


def test_a_change_of_the_tests_begins_anew_or_with_the_survivors(clone):
    first, _ = survey(clone)
    survived = sum(v.end == "survived" for v in first)
    more = "\n\ndef test_unseen():\n    assert guarded.unseen(2) and not guarded.unseen(3)\n"
    (clone / TESTS[0]).write_text(TEST + more)
    verdicts, new = survey(clone, survivors=True)
    assert new == survived < len(verdicts)
    assert "unseen killed" in ends(verdicts)
    assert survey(clone)[1] == len(verdicts) - survived


def test_a_copy_of_the_package_that_knows_the_clone_is_in_one():
    module = "ros_ws/src/loco_bringup/loco_bringup/graph/guard.py"
    with run.Nursery(ROOT, module, run.PROTECTING[module]) as nursery:
        assert nursery.ask((ROOT / module).read_text(), 200.0) == "0"


def test_how_tests_end(clone, monkeypatch):
    """By an import that fails, an error of pytest, a signal, or not at all."""
    monkeypatch.setattr(run, "PATIENCE", 2.0)
    ends = ("1 / 0", "os._exit(4)", "os.kill(os.getpid(), 9)", "os.kill(os.getpid(), 19)")
    source = ["import os", *(f"False and {end}" for end in ends), "seen = id\n"]
    (clone / MODULE).write_text("\n".join(source))
    (clone / TESTS[0]).write_text("import guarded\n\n\ndef test_seen():\n    assert guarded.seen\n")
    turned = [v for v in survey(clone)[0] if " or " in v.change]
    assert [v.end for v in turned] == ["killed", "error", "killed", "timeout"]


def test_tests_that_fail_anyway_are_refused(clone):
    (clone / TESTS[0]).write_text("def test_no():\n    assert False\n")
    with pytest.raises(LocoError, match="fail without a change"):
        survey(clone, limit=1)


@pytest.mark.parametrize(
    ("path", "text", "concerns"),
    [
        ("tests/guarded/test_beside.py", "", True),
        ("tests/more/test_more.py", "from guarded import this, other\n", True),
        ("tests/more/test_more.py", "def test():\n    import guarded.other as one\n", True),
        ("tests/more/test_more.py", "from guarded.other import unseen\n", True),
        ("tests/more/test_more.py", "from guarded import another\n", False),
        ("tests/more/test_more.py", "from guarded.others import other\n", False),
        ("tests/more/test_more.py", "import guarded\n", False),
    ],
)
def test_a_module_concerns_the_tests_of_its_folder_and_those_that_import_it(
    clone, monkeypatch, path, text, concerns
):
    module = "src/guarded/other.py"
    monkeypatch.setattr(run, "PROTECTING", {module: TESTS})
    for each, content in ((module, ""), (path, text)):
        write_whole(clone / each, content)
    assert run.elsewhere(clone, module) == (path,) * concerns


def test_what_its_tests_miss_is_noticed_by_others_and_is_one_verdict(clone):
    more = "import guarded\n\n\ndef test_unseen():\n    assert guarded.unseen(2)\n"
    write_whole(clone / "tests/guarded/test_more.py", more)
    verdicts, new = survey(clone)
    assert new == len(verdicts) == len({v.change for v in verdicts})
    assert ends(verdicts) == {"seen killed", "unseen survived"}
    missed = {v.change for v in verdicts if v.end == "survived"}
    assert missed == {"unseen: 3 -> 4", "unseen: x < 3 -> x <= 3"}


@pytest.mark.parametrize(
    ("words", "said"),
    [(["--only", "nobody"], "'nobody'"), (["--workers", "0"], "--workers at least 1")],
)
def test_a_mistake_is_one_line(words, said, capsys):
    with pytest.raises(SystemExit) as ended:
        main(["mutants", *words])
    assert ended.value.code == 2
    assert said in capsys.readouterr().err
