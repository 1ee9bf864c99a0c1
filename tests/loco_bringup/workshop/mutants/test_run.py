# SPDX-License-Identifier: Apache-2.0
"""A module with a test that sees one of its lines: the mutants of the other line survive."""

import pytest

from loco_bringup.cli.main import main
from loco_bringup.workshop.mutants import run
from loco_control.exceptions import LocoError

MODULE = "src/loco_sim/guarded.py"
SOURCE = "def seen(x):\n    return x + 1\n\n\ndef unseen(x):\n    return x < 3\n"
TEST = """
import importlib.util, os
path = os.environ["PYTHONPATH"].split(os.pathsep)[1] + "/guarded.py"
spec = importlib.util.spec_from_file_location("guarded", path)
guarded = importlib.util.module_from_spec(spec)
spec.loader.exec_module(guarded)


def test_seen():
    assert guarded.seen(1) == 2
"""


@pytest.fixture
def clone(tmp_path, monkeypatch):
    for folder in (*run.ROOTS, "tests"):
        (tmp_path / folder).mkdir(parents=True)
    (tmp_path / MODULE).write_text(SOURCE)
    (tmp_path / "tests/test_guarded.py").write_text(TEST)
    monkeypatch.setattr(run, "PROTECTING", {MODULE: ("tests/test_guarded.py",)})
    return tmp_path


def test_what_no_test_sees_survives(clone, tmp_path):
    told = []
    verdicts = run.survey(clone, [MODULE], 0, 0, 2, told.append)
    assert told == verdicts
    ends = {v.change.split(":")[0] + " " + v.end for v in verdicts}
    assert ends == {"seen killed", "unseen survived"}
    assert 0.0 < run.score(verdicts) < 1.0
    run.write(verdicts, tmp_path / "out")
    assert "unseen: x < 3 -> x <= 3" in (tmp_path / "out" / "mutants.md").read_text()


def test_tests_that_fail_anyway_are_refused(clone):
    (clone / "tests/test_guarded.py").write_text("def test_no():\n    assert False\n")
    with pytest.raises(LocoError, match="fail without a change"):
        run.survey(clone, [MODULE], 1, 0, 1, print)


@pytest.mark.parametrize(
    ("words", "said"),
    [(["--only", "nobody"], "'nobody'"), (["--workers", "0"], "--workers at least 1")],
)
def test_a_mistake_is_one_line(words, said, capsys):
    with pytest.raises(SystemExit) as ended:
        main(["mutants", *words])
    assert ended.value.code == 2
    assert said in capsys.readouterr().err
