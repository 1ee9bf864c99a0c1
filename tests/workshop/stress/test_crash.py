# SPDX-License-Identifier: Apache-2.0
"""Long commands that are killed, or whose disk gets full, come to the same end."""

import random
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from loco_bringup.cli import main as cli
from loco_bringup.cli.table import parse
from loco_workshop.reliability import figures
from loco_workshop.stress import crash, crash_terminal


def test_a_search_for_a_gap_that_is_killed_comes_to_the_same_bytes(tmp_path, monkeypatch):
    """The whole harness, on the command that was the last to learn it."""
    monkeypatch.delenv("COVERAGE_PROCESS_CONFIG", raising=False)  # others reach what it runs
    words = crash.COMMANDS["gap"].split()  # with one recording to fit and one effect to find
    short = [w for w in words if not w.endswith("/fit_steps") and w != "viscous_friction"]
    assert len(short) == len(words) - 2
    monkeypatch.setitem(crash.COMMANDS, "gap", " ".join(short))
    told = []
    row = crash.run(
        "gap", 1, 1, 3, tmp_path, lambda row: told.append(sum(row.hits.values()) + row.full)
    )
    assert row.ok, row.notes
    assert (row.hits["SIGKILL"], row.full, told) == (1, 1, [1, 2])
    assert row.ends >= 2  # more when a run ends before it is killed
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("line", [*crash.COMMANDS.values(), *crash.MAKES.values()])
def test_its_commands_are_commands(line):
    parse(line.replace("{}", "inputs").split())


@pytest.fixture
def trial(tmp_path):
    made = crash._Trial("study", tmp_path, random.Random(0))
    made._whole = {"table.md": b"whole", "case.npz": b"same", "log.jsonl": b"1\n2\n"}
    made.out.mkdir()
    return made


def leave(trial, **files):
    for name, data in files.items():
        (trial.out / name.replace("_", ".")).write_bytes(data)


def test_what_differs_is_torn_or_is_left_is_told(trial):
    leave(trial, table_md=b"who", case_npz=b"other", log_jsonl=b"1\n", more_txt=b"")
    trial._look_for_torn()
    assert trial.row.torn == 1  # a journal may end early, and another content is no torn file
    trial.compare()
    said = " ".join(trial.row.notes)
    for note in ("table.md is cut short", "more.txt is left", "case.npz differs"):
        assert note in said
    assert not trial.row.ok


def test_the_same_files_are_the_same(trial):
    leave(trial, table_md=b"whole", case_npz=b"same", log_jsonl=b"1\n2\n", times_csv=b"a,b")
    trial.compare()
    assert trial.row.ok
    assert trial.out.name == "run_1"
    assert "| `study` | 0 | 0 | 0 | 0 | 0 | 1 of 1 | 0 | 0 |" in crash_terminal.table([trial.row])


WORKER = """
import fcntl, signal, sys, time
from pathlib import Path
out = Path(sys.argv[sys.argv.index("--out") + 1])
out.mkdir(exist_ok=True)
journal = open(out / "log.jsonl", "a+")
try:
    fcntl.flock(journal, fcntl.LOCK_EX | fcntl.LOCK_NB)
except OSError:
    sys.exit({second})
try:
    journal.seek(0)
    begun = len(journal.readlines())
    for line in range(begun, 30):
        time.sleep(0.0 if begun or out.name == "whole" else 0.1)
        journal.write(f"{{line}}\\n")
        journal.flush()
    (out / "table.md").write_text("whole")
except KeyboardInterrupt:
    sys.exit({interrupted})
"""  # a long command, slow where it is disturbed; what it answers is filled in


@pytest.fixture
def toy(tmp_path, monkeypatch):
    """Function that makes a trial of a long command, which has run undisturbed."""

    def make(second='print("loco: another process is writing") or 2', interrupted="130"):
        text = WORKER.format(second=second, interrupted=interrupted)

        def start(words, limit=0):
            return subprocess.Popen(
                [sys.executable, "-c", text, *words], stdout=subprocess.PIPE,
                stderr=subprocess.STDOUT, text=True, start_new_session=True,
            )  # fmt: skip

        monkeypatch.setattr(crash, "start", start)
        made = crash._Trial("study", tmp_path, random.Random(0))
        made.undisturbed()
        made._work = 0.0  # the moment is that of the first result
        return made

    return make


@pytest.mark.parametrize("way", crash.WAYS)
def test_it_is_disturbed_in_its_work_and_comes_to_its_end(toy, way):
    trial = toy()
    assert trial.disturb(way)
    if trial.out.exists():
        assert (trial.out / "log.jsonl").read_text()  # it had begun
        trial.end()
    assert trial.row.ok, trial.row.notes
    assert trial.row.hits == {**dict.fromkeys(crash.WAYS, 0), way: 1}


@pytest.mark.parametrize(
    ("way", "answers", "note"),
    [
        ("SIGINT", {"interrupted": "1"}, "interrupted it ended with 1"),
        ("SIGINT", {"interrupted": "print('Traceback') or 130"}, "interrupted it ended with 130"),
        (crash.TWICE, {"second": "1"}, "two at once: one ended with 1"),
        (
            crash.TWICE,
            {"second": "print('a', 'b', sep=chr(10)) or 2"},
            "two at once: one ended with 2: a",
        ),
    ],
)
def test_an_answer_that_is_not_one_line_is_told(toy, way, answers, note):
    trial = toy(**answers)
    assert trial.disturb(way)
    assert note in " ".join(trial.row.notes)


@pytest.mark.parametrize(("hits", "full", "kept"), [(3, 0, ["crash"]), (0, 2, ["full disks"])])
def test_figures_are_kept_of_what_was_done(tmp_path, monkeypatch, hits, full, kept):
    row = crash.Row("gap", {**dict.fromkeys(crash.WAYS, 0), "SIGINT": hits}, full, ends=4, same=4)
    monkeypatch.setattr(crash, "run", lambda *_: row)
    with pytest.raises(SystemExit) as end:
        cli.main(["crash", "--only", "gap", "--out", str(tmp_path)])
    assert end.value.code == 0
    [figure] = figures.read(tmp_path / figures.NAME)
    assert (figure.subject, figure.part, figure.holds) == (kept[0], "gap", True)
    assert figure.values["ends with the same bytes"] == "4 of 4"
    assert figure.values.get("SIGINT", 0) == hits and figure.values.get("full disks", 0) == full


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        (
            ["--only", "walk"],
            "no long command named 'walk'; available: calibrate",
        ),
        (["--kills", "-1"], "--kills must be at least 0, got -1"),
    ],
)
def test_mistakes_are_one_line(arguments, text, capsys):
    with pytest.raises(SystemExit) as end:
        cli.main(["crash", *arguments])
    assert end.value.code == 2
    assert text in capsys.readouterr().err


def test_an_interrupt_leaves_no_run_behind(monkeypatch):
    process = crash.start(["top"])

    def interrupted(timeout=None):
        monkeypatch.undo()
        raise KeyboardInterrupt

    monkeypatch.setattr(process, "communicate", interrupted)
    with pytest.raises(KeyboardInterrupt):
        crash.finish(process)
    assert process.returncode == -signal.SIGKILL


def test_an_interrupt_in_the_work_leaves_no_run_behind(toy, tmp_path, monkeypatch):
    made = toy()
    monkeypatch.setattr(crash, "_Trial", lambda *_: made)
    monkeypatch.setattr(crash, "prepare", lambda *_: None)
    monkeypatch.setattr(made, "undisturbed", lambda: None)

    def interrupted(process, seconds):
        raise KeyboardInterrupt

    monkeypatch.setattr(crash, "_runs", interrupted)
    with pytest.raises(KeyboardInterrupt):
        crash.run("study", 1, 0, 0, tmp_path, lambda row: None)
    assert made._processes[-1].returncode == -signal.SIGKILL


def test_a_command_that_is_never_hit_is_told(toy, monkeypatch):
    made = toy()
    monkeypatch.setattr(made, "disturb", lambda way: False)
    made.hit("SIGINT")
    assert made.row.notes == ["run 0: 10 runs in a row were not hit by SIGINT"]


def test_a_run_is_interrupted_though_the_harness_is_in_the_background():
    before = signal.signal(signal.SIGINT, signal.SIG_IGN)
    try:
        process = crash.start(["top"])
    finally:
        signal.signal(signal.SIGINT, before)
    status = Path(f"/proc/{process.pid}/status").read_text()
    process.kill()
    process.communicate()
    ignored = int(status.partition("SigIgn:")[2].split()[0], 16)
    assert not ignored >> (signal.SIGINT - 1) & 1
