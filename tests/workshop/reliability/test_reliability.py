# SPDX-License-Identifier: Apache-2.0
"""The page of `loco reliability` is made of what commands measured, and claims what tests hold."""

import json
import re
import subprocess

import pytest

from loco_bringup.cli import main as cli
from loco_bringup.cli.clone import root
from loco_workshop import tests
from loco_workshop.reliability import figures, page, subjects, terminal
from loco_workshop.reliability.figures import Figure

MEASURED = {"command": "./loco x", "date": "2026-11-28T12:00", "commit": "abc", "machine": "m"}


@pytest.fixture
def place(tmp_path, monkeypatch):
    """A clone without figures, as the current folder."""
    (tmp_path / "docs").mkdir()
    monkeypatch.chdir(tmp_path)
    for module in (terminal, figures, tests):
        monkeypatch.setattr(module, "root", lambda: tmp_path)
    return tmp_path


def run(*words):
    with pytest.raises(SystemExit) as end:
        cli.main(["reliability", *words])
    return end.value.code


def rows(place):
    return figures.read(place / "docs" / page.FILE)


def test_without_figures_nothing_is_measured(place, capsys):
    assert run() == 0
    assert not any(each.date for each in rows(place))
    assert {each.subject for each in rows(place)} == set(subjects.SUBJECTS)
    printed = capsys.readouterr().out
    text = (place / "docs" / page.PAGE).read_text()
    for name, subject in subjects.SUBJECTS.items():
        assert f"not measured: {name}: ./loco {subject.command}" in printed
        assert f"[{name}](#{name.replace(' ', '-')})" in text
    assert text.count("Not measured: ") == len(subjects.SUBJECTS)
    assert all(each.part.rpartition("/")[2] in text for each in rows(place))


def test_each_part_has_the_newest_figures_and_they_stay(place, capsys):
    figures.keep(place / "results" / "fuzz", "fuzz", {"urdf": (True, {"inputs": 7, "finds": 0})})
    assert run() == 0
    figures.keep(place / "results" / "other", "fuzz", {"bag": (False, {"inputs": 9, "finds": 1})})
    figures.keep(place / "results" / "other", "fuzz", {"gone": (True, {"inputs": 1})})
    (place / "results" / "fuzz" / figures.NAME).unlink()
    assert run() == 1  # one is not as required
    found = {each.part: each for each in rows(place) if each.date}
    assert {part: each.values["inputs"] for part, each in found.items()} == {"urdf": 7, "bag": 9}
    assert found["urdf"].machine.endswith(tuple("0123456789"))
    assert "not as required: fuzz: bag" in capsys.readouterr().out
    assert "| `bag` | 9 | 1 | **no** |" in (place / "docs" / page.PAGE).read_text()


def test_the_newer_of_two_counts_and_of_a_subject_without_parts_the_newest_ten():
    old = Figure("soak", "hyq_trot_reflex", {}, True, **{**MEASURED, "date": "2026-11-27T12:00"})
    new = Figure("soak", "hyq_trot_reflex", {}, False, **MEASURED)
    assert figures.newest([new, old]) == figures.newest([old, new]) == [new]
    suites = [
        Figure("whole suite", f"{i:02}", {}, True, **{**MEASURED, "date": f"2026-11-{i:02}T01:00"})
        for i in range(1, 15)
    ]
    kept = [f.part for f in subjects.complete(suites) if f.subject == "whole suite"]
    assert kept == [f"{i:02}" for i in range(5, 15)]
    assert "whole suite" not in subjects.missing(suites) and "soak" in subjects.missing(suites)


def test_what_is_missing_is_run_and_its_figures_are_taken(place, monkeypatch):
    ran = []

    def measure(words, **_):
        if words[0] != "git":
            ran.append(" ".join(words[3:]))
            kept = {part: (True, {}) for part in subjects.SUBJECTS["chaos"].parts}
            figures.keep(place / "results" / "chaos", "chaos", kept)
        return subprocess.CompletedProcess(words, 0, "", "")

    monkeypatch.setattr(subprocess, "run", measure)
    assert run("--run", "chaos") == 0
    assert ran == ["chaos"]
    assert all(each.date for each in rows(place) if each.subject == "chaos")
    assert run("--run") == 0
    assert sorted(ran[1:]) == sorted(
        s.command for n, s in subjects.SUBJECTS.items() if n != "chaos"
    )


def test_mistakes_are_one_line(place, capsys):
    assert run("--run", "fuz") == 2
    assert "no subject named 'fuz'" in capsys.readouterr().err
    (place / "results" / "fuzz").mkdir(parents=True)
    for text in ('[{"subject": 1, "none": 2}]', "{}", "["):
        (place / "results" / "fuzz" / figures.NAME).write_text(text)
        assert run() == 2
        assert "results/fuzz/figures.json" in capsys.readouterr().err


def test_a_selection_of_tests_keeps_its_figures(place, monkeypatch):
    junit = '<testsuites><testsuite tests="5" failures="1" errors="0" skipped="2" time="90"/>'

    def pytests(words, **_):
        for word in words:
            if word.startswith("--junitxml="):
                open(word.partition("=")[2], "w").write(f"{junit}</testsuites>")
            if word.startswith("--cov-report=json:"):
                covered = {"totals": {"percent_covered": 95.93}}
                open(word.partition(":")[2], "w").write(json.dumps(covered))
        return subprocess.CompletedProcess(words, 1, "", "")

    monkeypatch.setattr(subprocess, "run", pytests)
    for name, (words, _) in tests.SUITES.items():
        assert tests.run_tests(words) == 1
        folder = place / "results" / name.replace(" ", "_")
        [figure] = figures.read(folder / figures.NAME)
        assert (figure.subject, figure.holds) == (name, False)
        assert (figure.values["passed"], figure.values["failed"]) == (2, 1)
        assert figure.values.get("covered %") == (95.9 if name == "coverage" else None)
    assert tests.run_tests(["-k", "other"]) == 1
    assert len(list(place.glob("results/*"))) == len(tests.SUITES)


@pytest.mark.parametrize(
    ("words", "all_tests"),
    [
        ("", True), ("--junitxml=a.xml", True), ("--junitxml a.xml -v", True), ("-q -r fE", True),
        ("-p other --tb=short", True), ("-p no:xdist", False), ("tests", False), ("-k a", False),
        ("-v tests", False), ("--junitxml=a.xml tests", False), ("-n 2", False), ("-x", False),
        ("--junitxml a.xml tests", False), ("--lf", False), ("--collect-only", False),
    ],
)  # fmt: skip
def test_all_tests_run_side_by_side_whatever_is_told_of_them(monkeypatch, words, all_tests):
    """With the options of a CI they took as long as one after another: it writes a JUnit file."""
    ran = []

    def pytests(command, **_):
        ran.append(command[command.index("pytest") + 1 :])
        return subprocess.CompletedProcess(command, 0, "", "")

    monkeypatch.setattr(subprocess, "run", pytests)
    monkeypatch.setattr(tests, "SUITES", {})  # keep no figures
    given = words.split()
    assert tests.run_tests(given) == 0
    kernels = [tests.KERNELS, [*tests.ALL_TESTS, *given]]
    assert ran == (kernels if all_tests else [given])


def test_long_groups_and_files_that_start_first_exist(repository):
    marks = re.findall(r'xdist_group\("(\w+)"', "".join(
        path.read_text() for path in (repository / "tests").rglob("test_*.py")))  # fmt: skip
    for scope in tests.LONG:
        assert scope in marks or (repository / scope).is_file(), scope


LINES = [line for lines in page.DECLARATION.values() for line in lines]


@pytest.mark.parametrize("line", LINES, ids=lambda line: line["says"][:40])
def test_what_is_declared_is_held_by_a_test_or_says_why_not(line):
    assert line["met"] in ("yes", "partly", "no")
    assert line.get("by") if line["met"] == "yes" else line.get("why")
    path, _, name = line.get("by", "").partition("::")
    assert (root() / path).exists()
    if name:
        assert re.search(rf"^def {name}\(", (root() / path).read_text(), re.MULTILINE)
