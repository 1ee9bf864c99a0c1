# SPDX-License-Identifier: Apache-2.0
"""The soak: what grows is named, what does not is flat, and a short one runs to its end."""

import os

import numpy as np
import pytest

from loco_bringup.cli import main as cli
from loco_control.exceptions import ParameterError
from loco_workshop.stress import soak


def samples(memory, descriptors, process="nodes"):
    rows = zip(memory, descriptors, strict=True)
    return [
        soak.Sample(i * 1000, i, process, m, int(d), 5, 3, 1.0) for i, (m, d) in enumerate(rows)
    ]


def says(rows):
    return {(v.process, v.what): v.says for v in soak.judge(rows)}


def test_noise_is_flat_and_a_leak_at_every_tick_grows():
    rng = np.random.default_rng(0)
    n = 1000  # a million ticks
    noise = 100.0 + 0.05 * rng.normal(size=n)
    leak = noise + 16.0 * np.arange(n) / n
    found = says([*samples(noise, np.full(n, 9)), *samples(leak, np.full(n, 9), "leaky")])
    assert found["nodes", "memory"] == "flat"
    assert found["leaky", "memory"] == "grows"
    assert found["nodes", "descriptors"] == found["nodes", "threads"] == "flat"


def test_what_a_start_takes_is_not_judged_and_a_short_run_settles_nothing():
    memory = np.where(np.arange(100) < 15, np.arange(100), 15.0)
    assert says(samples(memory, np.full(100, 9)))["nodes", "memory"] == "flat"
    few = says(samples(100.0 + np.arange(20) % 3, np.full(20, 9)))
    assert few["nodes", "memory"] == "not settled"


def test_one_descriptor_more_at_the_end_is_told():
    descriptors = 9 + (np.arange(200) > 150)
    assert says(samples(np.full(200, 100.0), descriptors))["nodes", "descriptors"] == "grows"


def test_a_sample_of_this_process_and_of_none():
    before = soak.take(os.getpid(), "me", 3, 0.5)
    with open(os.devnull):
        during = soak.take(os.getpid(), "me", 4, 0.6)
    assert before.memory > 1.0
    assert before.threads >= 1
    assert during.descriptors == before.descriptors + 1
    assert soak.take(2**22 + 1, "nobody", 0, 0.0) is None


@pytest.mark.ros
@pytest.mark.xdist_group("graph")
def test_a_short_soak_writes_table_and_picture(tmp_path):
    with pytest.raises(SystemExit) as end:
        cli.main(["soak", "hyq_short", "--ticks", "1500", "--out", str(tmp_path)])
    assert end.value.code in (0, 1)  # too short to judge memory
    rows = soak.read(tmp_path / "soak.csv")
    assert {row.process for row in rows} == {"nodes", "recorder", "supervisor"}
    assert (tmp_path / "soak.png").stat().st_size > 1000
    assert "6.0 s simulated; 0 messages dropped" in (tmp_path / "soak.md").read_text()


def test_a_soak_of_no_ticks_is_refused(tmp_path):
    with pytest.raises(ParameterError, match="at least 1000, got 5"):
        soak.soak(None, 5, tmp_path / "soak.csv")
