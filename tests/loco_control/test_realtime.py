# SPDX-License-Identifier: Apache-2.0
"""What is asked of the kernel is told as granted or refused, and never stops a process."""

import json
import os
import subprocess
import sys

import pytest

from loco_control.exceptions import ParameterError
from loco_control.realtime import RealtimeParams, prepare

ASK = """
import json, os, resource
from loco_control.realtime import RealtimeParams, prepare
{before}
said = prepare({wanted!r})
print(json.dumps([said, sorted(os.sched_getaffinity(0)), os.sched_getscheduler(0)]))
"""
WITHOUT_RIGHTS = """
resource.setrlimit(resource.RLIMIT_RTPRIO, (0, 0))
resource.setrlimit(resource.RLIMIT_MEMLOCK, (0, 0))
if os.getuid() == 0:
    os.setuid(65534)
"""


def in_a_process(wanted, before=""):
    """What a process that asks is told, and what it then has: the test's own stays as it is."""
    command = [sys.executable, "-c", ASK.format(before=before, wanted=wanted)]
    return json.loads(subprocess.run(command, capture_output=True, check=True, timeout=60).stdout)


def test_nothing_is_asked_by_default():
    assert prepare(RealtimeParams()) == []


def test_each_request_is_told_with_its_outcome():
    cpu = min(os.sched_getaffinity(0))
    wanted = RealtimeParams(fifo=1, cpus=str(cpu), lock_memory=True, timer_slack=1000)
    said, cpus, policy = in_a_process(wanted)
    names = ("SCHED_FIFO 1", f"processors {cpu}", "memory locked", "timer slack 1000 ns")
    assert [line.partition(":")[0] for line in said] == list(names)
    assert all(line.endswith("granted") or "refused" in line for line in said)
    assert cpus == [cpu]
    assert (policy == os.SCHED_FIFO) == said[0].endswith("granted")


def test_a_refusal_says_what_is_missing():
    wanted = RealtimeParams(fifo=80, cpus="100000", lock_memory=True)
    fifo, cpus, memory = in_a_process(wanted, WITHOUT_RIGHTS)[0]
    assert "refused" in fifo and "CAP_SYS_NICE" in fifo
    assert "refused" in cpus and "one of" in cpus
    assert "refused" in memory and "CAP_IPC_LOCK" in memory


@pytest.mark.parametrize("cpus", ["a", "1-3", "-1", "1,,2"])
def test_a_list_that_is_none_is_a_mistake(cpus):
    with pytest.raises(ParameterError, match="numbers such as 1 or 0,2"):
        RealtimeParams(cpus=cpus)


def test_a_priority_out_of_range_is_a_mistake():
    with pytest.raises(ParameterError, match=r"fifo must be in \[0, 99\]"):
        RealtimeParams(fifo=100)
