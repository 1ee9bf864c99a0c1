# SPDX-License-Identifier: Apache-2.0
"""The command line: exit codes, one clear line per mistake, help that names every command."""

import errno
import json
import os
import re
import subprocess
import sys

import pytest
import yaml

from loco_bringup.bag.reader import Bag
from loco_bringup.cli import listing
from loco_bringup.cli import main as cli
from loco_bringup.cli.table import COMMANDS, load, parse, parser, split
from loco_bringup.export_model.write import TARGETS
from loco_bringup.graph.run import LAYOUTS
from loco_bringup.logs.export import FORMATS
from loco_bringup.reproduce.terminal import WHAT
from loco_bringup.schemas import SCHEMAS
from loco_control.exceptions import MissingPackageError
from loco_learning.calibration.mawe import LOSSES
from loco_learning.calibration.parameters import SETS
from loco_sim import engines
from loco_sim.export.portable import GEARS
from loco_sim.msd.params import PRESETS
from loco_workshop import tests
from loco_workshop.bench import bench
from loco_workshop.bench.damage import sample


def loco(*arguments, capsys=None):
    """Exit code of the command, and what it printed."""
    with pytest.raises(SystemExit) as end:
        cli.main([str(a) for a in arguments])
    printed = capsys.readouterr()
    return end.value.code or 0, printed.out, printed.err


@pytest.fixture
def run(capsys, monkeypatch):
    monkeypatch.setenv("LOCO_ENGINE", "")  # `--engine` sets it; here it is put back
    return lambda *arguments: loco(*arguments, capsys=capsys)


def test_help_names_every_command_and_exit_code(run):
    code, out, _ = run("--help")
    assert code == 0
    for name in COMMANDS:
        assert re.search(rf"^  {name}  ", out, re.M), name
    assert "exit codes" in out
    assert re.search(r"^  (\w+) ", out, re.M)[1] == "gap"  # what loco is for comes first
    assert run() == run("help") == (0, out, "")


@pytest.mark.parametrize("name", [name for name, command in COMMANDS.items() if command.options])
def test_every_command_has_help_and_a_function(run, name):
    code, out, _ = run(*name.split(), "--help")
    assert code == 0
    word = name.partition(" --")[0]
    assert out.startswith(f"usage: loco {word} [-h]") and COMMANDS[name].text in out
    assert run("help", *name.split())[1].startswith(f"usage: loco {word} ")
    try:
        assert callable(load(COMMANDS[name].run))
    except MissingPackageError:  # an extra that is not in the default set-up
        assert name in ("view", "view --foxglove")


@pytest.mark.parametrize(
    ("line", "name", "rest"),
    [
        ("gap next results", "gap next", "results"),
        ("gap a next", "gap", "a next"),
        ("gap --robot x --live", "gap --live", "--robot x --live"),
        ("gap --robot x --liver", "gap", "--robot x --liver"),
        ("run a --layout rollout --seed 1", "run --layout rollout", "a --layout rollout --seed 1"),
        ("run a --layout=rollout", "run --layout rollout", "a --layout=rollout"),
        ("run a --layout processes", "run", "a --layout processes"),
        ("test --live", "test", "--live"),
    ],
)
def test_a_command_is_a_word_with_a_sub_command_or_an_option(line, name, rest):
    assert split(line.split()) == (name, rest.split())


def test_the_older_name_of_an_option_still_works():
    for line in ("gap a --{} b", "gap experiments a --{} b", "gap battery --{} b"):
        new, old = (parse(line.format(word).split()) for word in ("out", "output"))
        assert new == old and str(new[1].out) == "b"


def test_help_is_light():
    # Heavy imports would make every start slow.
    code = (
        "import sys, loco_bringup.cli.main as c; c.summary(); "
        "[c.parser(n).format_help() for n, row in c.COMMANDS.items() if row.options]; "
        "bad = {'numpy', 'rclpy', 'pybullet', 'matplotlib', 'numba'} & set(sys.modules); "
        "assert not bad, bad"
    )
    subprocess.run([sys.executable, "-c", code], check=True, timeout=60)


@pytest.mark.parametrize(("given", "wanted"), [(None, "1"), ("2", "2")])
def test_a_command_uses_one_thread_for_linear_algebra_unless_told_otherwise(given, wanted):
    # Not only where the script of a clone starts it. NumPy reads this when it is imported.
    code = (
        "import os, sys, loco_bringup.cli.main as c\n"
        "c._run = lambda words: print(os.environ['OMP_NUM_THREADS'], 'numpy' in sys.modules)\n"
        "c.main()"
    )
    mine = {k: v for k, v in os.environ.items() if not k.endswith("_NUM_THREADS")}
    mine |= {} if given is None else {"OMP_NUM_THREADS": given}
    done = subprocess.run(
        [sys.executable, "-c", code],
        env=mine,
        check=True,
        timeout=60,
        capture_output=True,
        text=True,
    )
    assert done.stdout.split() == [wanted, "False"]


MISTAKES = [
    (("run", "hyq_trott"), "hyq_trot_open"),
    (("run", "nowhere.yaml"), "nowhere.yaml"),
    (("run", "hyq_short", "--set", "gait.speed"), "KEY=VALUE"),
    (("run", "hyq_short", "--set", "gait.sped=0.3"), "did you mean 'speed'"),
    (("run", "hyq_short", "--set", "gait.speed=fast"), "must be a number"),
    (("run", "hyq_short", "--set", "gait.speed=9.0"), r"\[-1, 1\] m/s, got 9.0"),
    (("run", "hyq_short", "--set", "learner.memory=1.5"), "whole number"),
    (("run", "hyq_short", "--seed", "-4"), "seed"),
    (("run", "hyq_short", "--layout", "threads"), "composed, processes"),
    (("run", "hyq_short", "--set", "effects=[{name: pussh}]"), "push"),
    (("run", "hyq_short", "--clock", "sundial"), "lockstep"),
    (("run", "hyq_short", "--engine", "bullet"), "did you mean 'pybullet'"),
    (("run", "hyq_short", "--engine", "mujoco", "--set", "sim.restitution=0.5"), "leave it at 0"),
    (("run", "hyq_short", "--tick", "late=never"), "hold, safe-stop"),
    (("run", "hyq_short", "--tick", "clock=asap"), "take --clock"),
    (("run", "hyq_short", "--realtime", "fifo=100"), r"\[0, 99\]"),
    (("run", "hyq_short", "--realtime", "cpu=1"), "did you mean 'cpus'"),
    (("run", "hyq_short", "--realtime", "cpus=first"), "numbers such as"),
    (("soak", "--ticks", "10"), "at least 1000, got 10"),
    (("bench", "rls", "--rate", "100"), "no options rate"),
    (("bench", "realtime", "--seconds", "0.5"), "at least 2"),
    (("info", "nowhere"), "no bag at nowhere"),
    (("report", "nowhere"), "no bag at nowhere"),
    (("replay", "nowhere"), "no bag at nowhere"),
    (("study", "no_study"), "available"),
    (("bench", "lightness"), "rls"),
    (("list", "robtos"), "did you mean 'robots'"),
    (("schema", "robto"), "did you mean 'robot'"),
    (("schema",), "or a folder with --out"),
    (("gpa", "bag"), "did you mean 'gap'"),
    (("help", "gpa"), "did you mean 'gap'"),
    (("run",), "required: experiment; see `loco run --help`"),
    (("run", "hyq_short", "--sed", "3"), "unrecognized arguments: --sed 3"),
    (("run", "hyq_short", "--seed", "three"), "invalid int value: 'three'"),
    (("gap", "next", "."), "holds no gap.json"),
    (("gap", "--robot", "tigrillo"), "at least one recording"),
    (("gap", "battery", "--cases", "0"), "--cases must be above 0"),
    (("calibrate",), "a bag or --live"),
    (("calibrate", "bag", "--live"), "a bag or --live"),
    (("run", "hyq_short", "--layout", "rollout", "--tick", "late=hold"), "no --tick"),
]


@pytest.mark.parametrize(("arguments", "message"), MISTAKES, ids=lambda v: str(v)[:40])
def test_a_mistake_is_one_line_and_code_2(run, arguments, message, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    code, out, err = run(*arguments)
    assert code == 2
    assert re.search(message, err), err
    assert err.startswith("loco: ")
    assert "Traceback" not in err
    assert len(err.strip().splitlines()) == 1
    assert not list(tmp_path.iterdir())  # nothing half-written


@pytest.mark.parametrize("layout", ["composed", "processes", "rollout"])
def test_an_engine_that_is_not_there_is_said_before_a_run(run, layout, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(engines, "installed", lambda: ("mujoco",))
    code, _, err = run("run", "hyq_short", "--engine", "pybullet", "--layout", layout)
    message = "loco: sim.engine is 'pybullet', which is not installed; installed: mujoco\n"
    assert (code, err, list(tmp_path.iterdir())) == (2, message, [])


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("gait: {speed: 0.2", "line"),
        ("- a\n- b", "mapping"),
        ("gait: fast", "mapping"),
        ("robot: dog", "hyq"),
        ("effects: [{delay: 0.1}]", "name"),
    ],
)
def test_broken_experiment_files_are_named(run, text, message, tmp_path):
    path = tmp_path / "mine.yaml"
    path.write_text(text)
    code, _, err = run("run", path)
    assert code == 2
    assert message in err
    assert len(err.strip().splitlines()) == 1


def test_lists_show_what_there_is(run):
    code, out, _ = run("list")
    assert code == 0
    for word in ("hyq_trot_open", "chapter8", "command_delay", "robot_state"):
        assert word in out


def test_a_name_is_shown_with_what_it_is(run):
    code, out, _ = run("list", "coulomb_friction")
    assert code == 0 and "friction torque [N·m]" in out and "viscous_friction" not in out
    assert "hyq_short" in run("list", "hyq_short")[1]
    assert all(name in parser("list").format_help() for name in listing._LISTS)


def test_schemas_go_to_the_screen_or_to_files(run, tmp_path):
    code, out, _ = run("schema", "wiring")
    assert code == 0
    assert "servos" in json.loads(out)["properties"]
    assert run("schema", "--out", tmp_path / "schemas")[0] == 0
    assert {p.stem for p in (tmp_path / "schemas").iterdir()} == set(SCHEMAS)


@pytest.mark.ros
def test_run_info_and_replay_from_the_command_line(run, tmp_path):
    folder = tmp_path / "a bag"  # a path with a space
    code, out, _ = run(
        "run", "hyq_short", "--layout", "rollout", "--set", "duration=0.5", "--out", folder
    )
    assert code == 0
    assert "0.5 s simulated" in out
    code, out, _ = run("info", folder)
    assert code == 0
    assert "/robot_state" in out and "hyq_short" in out
    code, out, _ = run("replay", folder, "--speed", "0", "--topics", "robot_state")
    assert code == 0
    assert "125 messages of 1 topics" in out
    code, _, err = run("replay", folder, "--speed", "-1")
    assert code == 2 and "speed must be 0 or more" in err
    code, _, err = run("replay", folder, "--topics", "nothing")
    assert code == 2 and "robot_state" in err
    code, _, err = run("run", "hyq_short", "--out", folder)
    assert code == 2 and "holds a bag already" in err
    saved = yaml.safe_load((folder / "experiment.yaml").read_text())
    assert saved["duration"] == 0.5


def test_test_command_passes_arguments_to_pytest(run, monkeypatch):
    calls = []

    class Done:
        returncode = 5

    monkeypatch.setattr(tests.subprocess, "run", lambda c, **k: calls.append(c) or Done())
    code, _, _ = run("test", "-k", "nothing", "-x")
    assert code == 5
    assert calls[0][-3:] == ["-k", "nothing", "-x"]
    assert run("test", "--help")[0] == 5 and calls[1][-1] == "--help"


@pytest.mark.parametrize("words", [[], ["--cov"]])
def test_all_tests_begin_with_those_that_compile_without_coverage(
    run, monkeypatch, repository, words
):
    calls = []
    done = subprocess.CompletedProcess("", 5)
    monkeypatch.setattr(tests.subprocess, "run", lambda c, **k: calls.append(c) or done)
    assert run("test", *words)[0] == 5
    before, everything = calls
    assert ("--cov" in everything) == bool(words) and "--cov" not in before
    files = [word.partition("::")[0] for word in before if word.startswith("tests/")]
    assert files and all((repository / file).is_file() for file in files)


LONG = "x" * 300
TROUBLES = {  # place, and what the message has to name
    "not a folder": ("FILE/below", "file"),
    "name too long": (LONG, LONG[:50]),
    "null byte": ("a\0b", "null byte|a\0b"),
    "read-only": ("/proc/none", "/proc/none"),
}


@pytest.fixture(scope="module")
def bag(tmp_path_factory):
    folder = sample(tmp_path_factory.mktemp("bag") / "bag", ticks=50)
    data = Bag(folder).path.read_bytes()
    folder.with_name("cut.mcap").write_bytes(data[: 2 * len(data) // 3])
    return folder


@pytest.mark.parametrize("trouble", TROUBLES)
@pytest.mark.parametrize(
    "command",
    [
        ("record", "--duration", "0.1", "--out"),
        ("recover", "CUT", "--out"),
        ("export", "BAG", "--out"),
        ("extract", "BAG", "--topics", "robot_state", "--"),
        ("run", "hyq_short", "--layout", "rollout", "--set", "duration=0.1", "--out"),
        ("run", "hyq_short", "--out"),
        ("gap", "experiments", "servo_pendulum", "--out"),
        ("gap", "battery", "--cases", "1", "--workers", "1", "--bags-only", "--out"),
        ("bench", "effects", "--json"),
        ("info",),
        ("report",),
    ],
    ids=lambda c: " ".join(c),
)
def test_trouble_with_files_is_one_line_and_code_2(
    run, bag, command, trouble, tmp_path, monkeypatch
):
    """Whatever the operating system refuses, no command answers with a traceback."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(bench, "BENCHES", {"effects": ("title", "none", lambda: [{"a": 1.0}])})
    (tmp_path / "file").write_text("")
    place, message = TROUBLES[trouble]
    stand_ins = {"BAG": str(bag), "CUT": str(bag.with_name("cut.mcap"))}
    words = [stand_ins.get(word, word) for word in command]
    code, _, err = run(*words, place.replace("FILE", str(tmp_path / "file")))
    assert code == 2
    assert err.startswith("loco: ") and len(err.strip().splitlines()) == 1, err
    assert re.search(message, err), err


@pytest.mark.parametrize(
    "error",
    [
        MemoryError("Unable to allocate 8 GiB"),
        ImportError("_arpacklib.so: failed to map segment from shared object"),
    ],
    ids=lambda error: type(error).__name__,
)
def test_too_little_memory_is_one_line(run, monkeypatch, error):
    def refuse(a):
        raise error

    monkeypatch.setattr(listing, "show", refuse)
    code, _, err = run("list")
    assert code == 1
    assert err.startswith("loco: there is not enough memory; ") and err.count("\n") == 1


def test_a_package_that_is_broken_is_no_lack_of_memory(run, monkeypatch):
    def refuse(a):
        raise ImportError("cannot import name 'x'")

    monkeypatch.setattr(listing, "show", refuse)
    with pytest.raises(ImportError, match="cannot import"):
        run("list")


@pytest.mark.parametrize("number", [errno.ENOSPC, errno.EROFS, errno.EACCES, errno.EDQUOT])
def test_an_error_of_the_system_names_the_file_and_a_way_out(run, monkeypatch, number):
    def refuse(a):
        raise OSError(number, os.strerror(number), "some/file")

    monkeypatch.setattr(listing, "show", refuse)
    code, _, err = run("list")
    assert code == 2
    assert err.startswith(f"loco: {os.strerror(number)}: some/file; ")


def completed(script, *words):
    """Words that bash offers after these, the last of them begun."""
    line = " ".join(f"'{word}'" for word in words)
    ask = f"{script}\nCOMP_WORDS=({line}); COMP_CWORD={len(words) - 1}; _loco_complete; "
    ask += 'printf "%s\\n" "${COMPREPLY[@]}"'
    return subprocess.run(["bash", "-c", ask], capture_output=True, text=True, check=True).stdout


def test_a_shell_completes_commands_options_and_names(run, tmp_path, monkeypatch):
    code, script, _ = run("completion", "bash")
    assert code == 0
    monkeypatch.chdir(tmp_path)
    (tmp_path / "servo_mine.yaml").touch()
    assert completed(script, "loco", "ga").split() == ["gap"]
    assert completed(script, "loco", "run", "servo").split() == [
        "servo_pendulum_sine", "servo_mine.yaml",
    ]  # fmt: skip
    assert completed(script, "loco", "gap", "--hold").split() == ["--hold-out"]
    assert completed(script, "loco", "gap", "ne").split() == ["next"]
    assert completed(script, "loco", "list", "rob").split() == ["robots"]
    assert completed(script, "loco", "export-model", "hyq", "--to", "mj").split() == ["mjcf"]
    assert run("completion", "fish")[0] == 2


CHOICES = [
    ("schema", "kind", SCHEMAS), ("reproduce", "what", WHAT),
    ("export-model", "to", TARGETS), ("export-model", "gear", GEARS), ("export", "format", FORMATS),
    ("run", "layout", (*LAYOUTS, "rollout")), ("replay --verify", "layout", LAYOUTS),
    ("calibrate", "parameters", SETS), ("calibrate", "loss", LOSSES),
    ("reproduce", "preset", PRESETS),
]  # fmt: skip


@pytest.mark.parametrize(("name", "option", "names"), CHOICES)
def test_the_choices_in_the_usage_are_those_that_there_are(name, option, names):
    (action,) = (a for a in parser(name)._actions if a.dest == option)
    assert set(action.choices) == set(names)


def test_the_length_of_a_run_has_an_option(run, tmp_path):
    words = "run servo_pendulum_sine --layout rollout --duration 0.25".split()
    assert run(*words, "--out", tmp_path / "short")[0] == 0
    bag = Bag(tmp_path / "short")
    assert bag.topics["/joint_states"].count == 25
