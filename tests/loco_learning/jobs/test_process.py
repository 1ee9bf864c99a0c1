# SPDX-License-Identifier: Apache-2.0
"""No worker outlives the process that started it."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

PARENT = """
import multiprocessing, sys, time
sys.path.insert(0, {folder!r})
from {module} import busy
if __name__ == "__main__":
    worker = multiprocessing.get_context("spawn").Process(target=busy)
    worker.start()
    print(worker.pid, flush=True)
    time.sleep(60.0)
"""


def busy() -> None:
    """A worker that never looks at a pipe."""
    from loco_learning.jobs.process import end_with_parent

    end_with_parent()
    while True:
        sum(range(1000))


def alive(pid: int) -> bool:
    try:
        stat = Path(f"/proc/{pid}/stat").read_text(encoding="ascii")
    except FileNotFoundError:
        return False
    return stat.rsplit(")", 1)[1].split()[0] != "Z"


def test_a_busy_worker_ends_when_its_parent_is_killed(tmp_path):
    script = tmp_path / "parent.py"
    here = Path(__file__)
    script.write_text(PARENT.format(folder=str(here.parent), module=here.stem), encoding="utf-8")
    with subprocess.Popen([sys.executable, str(script)], stdout=subprocess.PIPE) as parent:
        worker = int(parent.stdout.readline())
        time.sleep(0.5)
        assert alive(worker)
        os.kill(parent.pid, signal.SIGKILL)
    until = time.monotonic() + 20.0
    while alive(worker) and time.monotonic() < until:
        time.sleep(0.05)
    assert not alive(worker)


BARE = """
from loco_learning.jobs import pool
print("begun")
with pool.start(abs, workers=2) as jobs:
    print(list(jobs.ordered([(-1,), (-2,)])))
"""

GUARDED = """
from loco_learning.jobs import pool

def twice(x):
    return 2 * x

if __name__ == "__main__":
    print("begun")
    with pool.start(twice, workers=2) as jobs:
        print(list(jobs.ordered([(-1,), (-2,)])))
    print(__file__)
"""


@pytest.mark.parametrize(("script", "results"), [(BARE, [1, 2]), (GUARDED, [-2, -4])])
def test_a_script_runs_once_whether_it_asks_for_its_name_or_not(script, results, tmp_path):
    path = tmp_path / "script.py"
    path.write_text(script)
    done = subprocess.run([sys.executable, path], capture_output=True, text=True, timeout=100)
    lines = done.stdout.splitlines()
    assert lines[:2] == ["begun", str(results)], done.stderr
    assert lines[2:] == ([str(path)] if "__file__" in script else [])
