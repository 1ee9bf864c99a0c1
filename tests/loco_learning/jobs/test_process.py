# SPDX-License-Identifier: Apache-2.0
"""No worker outlives the process that started it."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

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
