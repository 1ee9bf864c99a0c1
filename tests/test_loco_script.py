# SPDX-License-Identifier: Apache-2.0
"""The ./loco script, run with a stand-in for Python that only writes down its arguments."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
from pathlib import Path

import pytest

TOOLS = "sh cat cksum cp chmod dirname env flock grep mkdir readlink rm sed sleep tail".split()

# Each stage by a part of the command that does it, in order.
VENV = "-m venv"
REQUIREMENTS = "requirements/lock.txt"
MESSAGES = "messages.py install"
PACKAGES = "pip install --no-deps --no-build-isolation -e"
COMMAND = ".venv/bin/loco"
TOOLS_STAGE = "requirements/tools.txt"
GENERATORS = "requirements/build.txt"
BUILD = "messages.py build"
STAGES = [VENV, REQUIREMENTS, MESSAGES, PACKAGES]

STAND_IN = """#!/bin/sh
case "$1 $2" in "-I -c"* | *"messages.py check") ;; *) echo "$*" >>"$CALLS" ;; esac
case "$*" in
*${KILL_AT:-nothing}*) kill -9 $PPID; exit ;;
*${FAIL_AT:-nothing}*) echo "out of cheese" >&2; exit 3 ;;
esac
case "$1 $2" in
"-I -c"*) echo "$0" ;;
*"messages.py check") [ -z "${MISFIT:-}" ] || { echo "$MISFIT"; exit 1; } ;;
"-m venv") sleep 0.2; mkdir -p "$3/bin"; cp "$0" "$3/bin/python"
    [ -z "${WITH_UV:-}" ] || cp "$0" "$3/bin/uv" ;;
*".venv/bin/loco"*) env >"$CALLS.env" ;;
esac
"""


class Checkout:
    """A copy of the script with the files it reads, and a PATH of a few tools."""

    def __init__(self, folder: Path, script: Path) -> None:
        self.root = folder / "with space" / "loco"
        self.bin = folder / "bin"
        self.calls = folder / "calls"
        for file in (
            "requirements/lock.txt",
            "requirements/build.txt",
            "requirements/messages.zip",
            "requirements/tools.txt",
            "pyproject.toml",
            "src/loco_msgs/CMakeLists.txt",
            "src/loco_msgs/msg/A.msg",
            "src/tf2_msgs/CMakeLists.txt",
            "src/tf2_msgs/msg/B.msg",
        ):
            (self.root / file).parent.mkdir(parents=True, exist_ok=True)
            (self.root / file).write_text("one\n")
        shutil.copy(script, self.root / "loco")
        self.bin.mkdir()
        for tool in TOOLS:
            (self.bin / tool).symlink_to(shutil.which(tool))
        self.environment = {
            "PATH": str(self.bin),
            "HOME": str(folder),
            "CALLS": str(self.calls),
        }

    def add(self, name: str, text: str = STAND_IN) -> Path:
        """Put an executable on the PATH (or elsewhere, when `name` is a path)."""
        path = self.bin / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
        path.chmod(0o755)
        return path

    def popen(self, *arguments: str, **environment: str) -> subprocess.Popen:
        """Start the script; its output can be read with `communicate`."""
        return subprocess.Popen(
            [self.root / "loco", *arguments],
            env=self.environment | environment,
            stderr=subprocess.PIPE,
            text=True,
        )

    def start(self, *arguments: str, **environment: str) -> tuple[int, str, list[str]]:
        """Run the script: exit status, what it told the user, and what it made Python do."""
        self.calls.write_text("")
        process = self.popen(*arguments, **environment)
        _, told = process.communicate(timeout=30)
        calls = self.calls.read_text().splitlines()
        return process.returncode, told, calls


@pytest.fixture
def checkout(tmp_path: Path, repository: Path) -> Checkout:
    made = Checkout(tmp_path, repository / "loco")
    made.add("python3.11")
    return made


def stages(calls: list[str]) -> list[str]:
    """Which stages the calls belong to, in order and once each."""
    known = [*STAGES, GENERATORS, BUILD, TOOLS_STAGE, COMMAND]
    firsts = [next((s for s in known if s in call), "") for call in calls]
    return list(dict.fromkeys(filter(None, firsts)))


def test_first_start_does_every_stage_in_order_and_then_the_command(checkout):
    status, told, calls = checkout.start("report", "a bag")
    assert status == 0
    assert stages(calls) == [*STAGES, COMMAND]
    assert calls[-1] == f"{checkout.root}/.venv/bin/loco report a bag"
    assert "ready" in told


def test_uv_installs_the_packages_where_it_is(checkout):
    status, _, calls = checkout.start("list", WITH_UV="1")
    python = f"{checkout.root}/.venv/bin/python"
    words = f"pip install --python {python} --no-deps --no-build-isolation -e {checkout.root}"
    assert status == 0 and words in calls
    assert stages(calls) == [VENV, REQUIREMENTS, MESSAGES, COMMAND]


@pytest.fixture
def compilers(checkout) -> None:
    checkout.add("cc", "#!/bin/sh\n")
    checkout.add("c++", "#!/bin/sh\n")


def test_messages_that_do_not_fit_are_built_and_the_reason_is_told(checkout, compilers):
    status, told, calls = checkout.start(MISFIT="none for this Python")
    assert status == 0
    assert stages(calls) == [VENV, REQUIREMENTS, GENERATORS, BUILD, PACKAGES, COMMAND]
    assert "building the messages: none for this Python" in told


def test_a_build_that_fails_ends_the_setup_and_is_repeated(checkout, compilers):
    status, told, _ = checkout.start(MISFIT="none", FAIL_AT=BUILD)
    assert status == 1 and "out of cheese" in told
    assert stages(checkout.start(MISFIT="none")[2])[:2] == [GENERATORS, BUILD]


def test_asking_for_a_build_repeats_the_stage_and_so_does_asking_no_more(checkout):
    checkout.start()
    assert stages(checkout.start(LOCO_COMPILE="1")[2]) == [MESSAGES, COMMAND]
    assert stages(checkout.start()[2]) == [MESSAGES, COMMAND]


@pytest.mark.parametrize("command", ["test", "colcon", "bench", "mutants"])
def test_tools_are_installed_when_they_are_asked_for(checkout, command):
    (checkout.root / "ros_ws").mkdir()
    assert TOOLS_STAGE not in stages(checkout.start("list")[2])
    assert stages(checkout.start(command)[2])[:2] == [GENERATORS, TOOLS_STAGE]
    assert TOOLS_STAGE not in stages(checkout.start(command)[2])
    (checkout.root / "requirements/tools.txt").write_text("two\n")
    assert TOOLS_STAGE not in stages(checkout.start("list")[2])
    assert stages(checkout.start(command)[2])[:2] == [GENERATORS, TOOLS_STAGE]


def test_second_start_only_runs_the_command(checkout):
    checkout.start()
    assert checkout.start("list") == (0, "", [f"{checkout.root}/.venv/bin/loco list"])


def test_started_through_a_link_it_finds_its_folder(checkout, tmp_path):
    checkout.start()
    link = tmp_path / "link"
    link.symlink_to(checkout.root / "loco")
    subprocess.run([link], env=checkout.environment, cwd="/", check=True)
    assert checkout.calls.read_text().endswith("/.venv/bin/loco\n")


@pytest.mark.parametrize(
    ("file", "expected"),
    [
        ("requirements/lock.txt", STAGES),
        ("requirements/messages.zip", [MESSAGES]),
        ("src/loco_msgs/msg/A.msg", [MESSAGES]),
        ("src/loco_msgs/CMakeLists.txt", [MESSAGES]),
        ("src/tf2_msgs/msg/B.msg", [MESSAGES]),
        ("pyproject.toml", [PACKAGES]),
    ],
)
def test_a_changed_file_repeats_the_stages_made_from_it(checkout, file, expected):
    checkout.start()
    (checkout.root / file).write_text("two\n")
    assert stages(checkout.start()[2]) == [*expected, COMMAND]
    assert stages(checkout.start()[2]) == [COMMAND]


def test_a_moved_folder_gets_a_new_environment(checkout):
    checkout.start()
    checkout.root = checkout.root.rename(checkout.root.with_name("moved"))
    assert stages(checkout.start()[2]) == [*STAGES, COMMAND]


def test_an_environment_whose_python_is_gone_is_made_anew(checkout):
    checkout.start()
    (checkout.root / ".venv/bin/python").unlink()
    assert stages(checkout.start()[2]) == [*STAGES, COMMAND]


@pytest.mark.parametrize("stage", STAGES)
def test_a_killed_setup_repairs_itself(checkout, stage):
    """What came before the stage is kept, but never half an environment."""
    status, _, _ = checkout.start(KILL_AT=stage)
    assert status == -9
    status, _, calls = checkout.start()
    assert status == 0
    assert stages(calls)[0] == {REQUIREMENTS: VENV}.get(stage, stage)
    assert stages(checkout.start()[2]) == [COMMAND]


def test_a_failing_step_shows_the_end_of_the_log(checkout):
    status, told, calls = checkout.start(FAIL_AT=REQUIREMENTS)
    assert status == 1
    assert "out of cheese" in told
    assert ".venv/setup.log" in told
    assert stages(calls) == [VENV, REQUIREMENTS]


def test_two_starts_at_once_make_one_environment(checkout):
    checkout.calls.write_text("")
    processes = [checkout.popen(), checkout.popen()]
    told = [process.communicate(timeout=30)[1] for process in processes]
    calls = checkout.calls.read_text()
    assert [process.returncode for process in processes] == [0, 0]
    assert calls.count(VENV) == 1
    assert calls.count(COMMAND) == 2
    assert "waiting for another set-up" in "".join(told)


def test_a_missing_python_is_told(checkout):
    (checkout.bin / "python3.11").unlink()
    status, told, _ = checkout.start()
    assert status == 1
    assert "found no CPython 3.10 to 3.13" in told
    assert "LOCO_PYTHON" in told


def test_a_python_that_will_not_do_is_passed_over(checkout):
    checkout.add("python3.11", "#!/bin/sh\nexit 1\n")
    usable = checkout.add("python3.12")
    _, told, _ = checkout.start()
    assert f"making .venv with {usable}" in told


def test_pyenv_is_searched(checkout, tmp_path):
    (checkout.bin / "python3.11").unlink()
    usable = checkout.add(str(tmp_path / ".pyenv/versions/3.11.7/bin/python"))
    _, told, _ = checkout.start()
    assert f"making .venv with {usable}" in told


def test_the_python_asked_for_is_used_or_refused(checkout):
    usable = checkout.add("my-python")
    assert f"making .venv with {usable}" in checkout.start(LOCO_PYTHON="my-python")[1]
    shutil.rmtree(checkout.root / ".venv")
    status, told, _ = checkout.start(LOCO_PYTHON="no-python")
    assert status == 1
    assert "LOCO_PYTHON=no-python is not CPython 3.10 to 3.13" in told


@pytest.mark.parametrize("compiler", ["cc", "c++"])
def test_a_missing_compiler_is_told_before_anything_is_installed(checkout, compilers, compiler):
    (checkout.bin / compiler).unlink()
    status, told, calls = checkout.start(MISFIT="none for this Python")
    assert status == 1
    assert f"compiler '{compiler}'" in told and "apt install g++" in told
    assert "none for this Python" in told
    assert calls == []


def test_missing_headers_are_told_before_anything_is_installed(checkout, compilers):
    status, told, calls = checkout.start(MISFIT="none for this Python", FAIL_AT="Python.h")
    assert status == 1
    assert "found no Python.h" in told and "apt install python3-dev" in told
    assert stages(calls) == []


def test_a_missing_compiler_is_told_when_messages_change(checkout):
    """The environment was made with those that are shipped, on a machine without compilers."""
    checkout.start()
    (checkout.root / "src/loco_msgs/msg/A.msg").write_text("two\n")
    status, told, calls = checkout.start(MISFIT="made from other messages")
    assert status == 1
    assert "compiler 'cc'" in told and "made from other messages" in told
    assert stages(calls) == []
    assert stages(checkout.start()[2]) == [MESSAGES, COMMAND]


def seen_by_the_command(checkout: Checkout) -> dict[str, str]:
    """Environment variables in which the loco command was started."""
    text = Path(f"{checkout.calls}.env").read_text()
    return dict(line.partition("=")[::2] for line in text.splitlines())


def test_threads_are_limited(checkout):
    checkout.start()
    seen = seen_by_the_command(checkout)
    assert seen["OMP_NUM_THREADS"] == seen["OPENBLAS_NUM_THREADS"] == "1"


@pytest.mark.parametrize("sign", ["AMENT_PREFIX_PATH", "_ROS_WHEELS_BOOTSTRAP_COMPLETE"])
def test_libraries_of_another_ros_are_dropped(checkout, sign):
    other = {sign: "/opt/ros/jazzy", "LD_LIBRARY_PATH": "/opt", "PYTHONPATH": "/opt"}
    checkout.start(**other)
    assert not set(other) & set(seen_by_the_command(checkout))


def test_colcon_runs_in_the_workspace_with_the_environment(checkout):
    (checkout.root / "ros_ws").mkdir()
    _, _, calls = checkout.start("colcon", "build", "--packages-select", "loco_sim")
    assert calls[-1] == "-m colcon build --packages-select loco_sim"


def direct_url(checkout: Checkout) -> Path:
    """The file in which pip says where it took the packages from."""
    packages = checkout.root / ".venv/lib/python3.11/site-packages"
    path = packages / "loco_gap-0.2.0.dist-info/direct_url.json"
    path.parent.mkdir(parents=True, exist_ok=True)
    return path


@pytest.mark.parametrize(
    "other",
    [
        '{"dir_info": {}, "url": "file:///here"}',
        '{"dir_info": {"editable": true}, "url": "file:///there"}',
        None,
    ],
    ids=["a copy", "another folder", "uninstalled"],
)
def test_packages_that_point_elsewhere_are_installed_anew(checkout, other):
    checkout.start()
    path = direct_url(checkout)
    path.write_text('{"dir_info": {"editable": true}, "url": "file:///here"}')
    assert stages(checkout.start("list")[2]) == [PACKAGES, COMMAND]
    assert stages(checkout.start("list")[2]) == [COMMAND]
    path.unlink() if other is None else path.write_text(other)
    assert stages(checkout.start("list")[2]) == [PACKAGES, COMMAND]


@pytest.fixture
def extras(checkout: Checkout, repository: Path) -> Checkout:
    """A checkout with the real extras and two locked requirements."""
    shutil.copy(repository / "pyproject.toml", checkout.root)
    lines = [
        "numpy==2.0.1 \\",
        "    --hash=sha256:0",
        "x==1 ; python_version < '4' \\",
        "    --hash=sha256:1",
    ]
    lock = "\n".join(lines) + "\n"
    (checkout.root / "requirements/lock.txt").write_text(lock)
    checkout.start()
    return checkout


def texts(repository: Path) -> dict[Path, str]:
    """Content of each program and each page that users read."""
    folders = [
        repository / name
        for name in ("src", "ros_ws/src", "tests/workshop", "docs", "requirements")
    ]
    files = [path for folder in folders for path in folder.rglob("*") if path.is_file()]
    kinds = {".py", ".md", ".in", ".ipynb"}
    return {path: path.read_text() for path in files if path.suffix in kinds}


def test_every_printed_hint_installs_its_extra(extras, repository):
    printed = set(re.findall(r"\./loco install ([a-z]+)", " ".join(texts(repository).values())))
    assert {"view", "rl", "ppo", "battery", "dynamixel", "docs", "test"} <= printed
    for extra in printed:
        status, _, calls = extras.start("install", extra)
        assert status == 0, extra
        assert calls[-1].endswith(f"-e {extras.root}[{extra}]")


def test_extras_leave_the_packages_editable_and_what_is_locked_alone(extras):
    status, _, calls = extras.start("install", "view", "rl")
    pins = extras.root / ".venv/pins.txt"
    assert status == 0
    assert calls == [f"-m pip install --no-build-isolation -c {pins} -e {extras.root}[view,rl]"]
    assert pins.read_text() == "numpy==2.0.1\nx==1 ; python_version < '4'\n"


@pytest.mark.parametrize("names", [(), ("veiw",), ("view", "."), ("view,rl",), ("",)])
def test_extras_that_do_not_exist_are_refused_and_the_others_listed(extras, names):
    status, told, calls = extras.start("install", *names)
    assert (status, calls) == (1, [])
    assert "view" in told.split("there are:")[-1].split() or "lerobot" in told


def test_extras_that_fail_to_install_show_why(extras):
    status, told, _ = extras.start("install", "view", FAIL_AT="[view]")
    assert status == 1
    assert "out of cheese" in told


def test_no_hint_replaces_the_packages_of_a_clone(repository):
    """`pip install '.[view]'` in the environment of ./loco puts a copy in their place."""
    hint = re.compile(r"pip install ['\"]?(\.|loco-gap)\[")
    assert [path for path, text in texts(repository).items() if hint.search(text)] == []


def test_the_probe_accepts_this_python(checkout):
    """The only test that runs a real interpreter: the one of the tests is a legal one."""
    text = (checkout.root / "loco").read_text()
    probe = text.split("probe='")[1].split("'\n")[0]
    base = os.path.realpath("/proc/self/exe")
    subprocess.run([base, "-c", probe], check=True, capture_output=True)


def test_compiled_modules_are_kept_also_where_the_environment_forbids_it(checkout):
    """Else each process of a graph compiles some 300 modules anew."""
    checkout.start("report", PYTHONDONTWRITEBYTECODE="1", PYTHONHOME="elsewhere")
    given = Path(f"{checkout.calls}.env").read_text()
    assert "CALLS=" in given
    assert "PYTHONDONTWRITEBYTECODE" not in given and "PYTHONHOME" not in given
