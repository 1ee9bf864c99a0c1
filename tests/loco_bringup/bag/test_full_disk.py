# SPDX-License-Identifier: Apache-2.0
"""A full disk ends the recording, keeps a whole bag and says so."""

import os
import subprocess
import sys

import pytest

from loco_bringup.bag.reader import Bag

# Coverage would save its own file under the limit of these processes, and complain.
ENVIRONMENT = {k: v for k, v in os.environ.items() if not k.startswith("COV")}

WRITE = """
import resource, sys
from pathlib import Path
import numpy as np
from loco_bringup.bag.writer import BagWriter
from loco_control.ros.messages.definitions import definition, type_hash

folder, limit, attached = Path(sys.argv[1]), int(sys.argv[2]), int(sys.argv[3])
resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit))
rng = np.random.default_rng(0)
writer = BagWriter(folder, {"experiment": "full"}, 4096)
kind = "std_msgs/msg/Float64"
writer.add_topic("/x", kind, definition(kind), type_hash(kind), [])
given = 0
for k in range(20_000):
    writer.write("/x", b"\\0\\1\\0\\0" + rng.bytes(8), k * 1_000_000)
    given += 1
writer.attach("experiment.yaml", bytes(rng.integers(0, 256, attached, dtype=np.uint8)))
writer.close()
print(given, writer.failed, *writer.kept, sep="|")
"""


def write(folder, limit, attached=500):
    done = subprocess.run(
        [sys.executable, "-c", WRITE, str(folder), str(limit), str(attached)],
        capture_output=True, text=True, env=ENVIRONMENT, timeout=60,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    given, failed, kept, end = done.stdout.strip().split("|")
    return int(given), failed, int(kept), float(end)


@pytest.mark.parametrize("attached", [500, 40_000])
def test_what_came_before_is_a_whole_bag(tmp_path, attached):
    folder = tmp_path / "full"
    limit = 200_000
    given, failed, kept, end = write(folder, limit, attached)
    assert given == 20_000  # the program went on
    assert "too large" in failed or "No space" in failed
    bag = Bag(folder)
    assert 0 < kept == bag.topics["/x"].count == len(bag.raw("x")[1])
    assert bag.end == pytest.approx(end) == pytest.approx((kept - 1) / 1e3)
    assert "recording_stopped" in bag.metadata
    assert bag.attachments() == {"experiment.yaml": attached}
    size = bag.path.stat().st_size
    assert limit - 3 * 4096 - attached < size <= limit
    assert f"message_count: {kept}" in (folder / "metadata.yaml").read_text()


def test_without_a_limit_nothing_is_left_out(tmp_path):
    given, failed, kept, _ = write(tmp_path / "free", 1 << 30)
    assert (given, failed, kept) == (20_000, "", 20_000)
    assert not (tmp_path / "free" / "recording.progress").exists()


RUN = """
import resource, sys
resource.setrlimit(resource.RLIMIT_FSIZE, (700_000, 700_000))
from loco_bringup.cli.main import main
main(["run", "hyq_short", "--out", sys.argv[1], "--set", "learner.train=1.0"])
"""


@pytest.mark.ros
def test_a_run_goes_on_and_says_that_its_recording_stopped(tmp_path):
    folder = tmp_path / "run"
    done = subprocess.run(
        [sys.executable, "-c", RUN, str(folder)],
        capture_output=True, text=True, env=ENVIRONMENT, timeout=100,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert "recording stopped: File too large" in done.stdout
    assert "4.0 s simulated" in done.stdout
    bag = Bag(folder)
    assert 0.5 < bag.end < 3.9
    assert "experiment.yaml" in bag.attachments()
    assert len(bag.records("robot_state")) == bag.topics["/robot_state"].count


COPY = """
import resource, sys
resource.setrlimit(resource.RLIMIT_FSIZE, (20_000, 20_000))
from loco_bringup.cli.main import main
main(["extract", sys.argv[1], sys.argv[2], "--topics", "x"])
"""


def test_a_copy_without_room_is_an_error(tmp_path):
    write(tmp_path / "whole", 1 << 30)
    done = subprocess.run(
        [sys.executable, "-c", COPY, str(tmp_path / "whole"), str(tmp_path / "copy")],
        capture_output=True, text=True, env=ENVIRONMENT, timeout=60,
    )  # fmt: skip
    assert done.returncode == 2
    assert "not complete: File too large" in done.stderr and "Traceback" not in done.stderr
