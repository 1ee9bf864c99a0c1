# SPDX-License-Identifier: Apache-2.0
"""Levels of diagnostics follow from the values and their limits."""

import os
import subprocess
import time
from types import SimpleNamespace

import pytest

from loco_control.exceptions import ParameterError
from loco_control.ros.endpoints import living, low_pid, own_host
from loco_control.ros.health import ERROR, OK, WARN, HealthParams, PeriodMeter, UsageMeter, judge


def test_a_quiet_report_is_ok():
    assert judge(HealthParams(), {"silence": 0.1, "ticks": 250}) == (OK, "running")


@pytest.mark.parametrize(("silence", "level"), [(1.9, OK), (2.0, WARN), (9.9, WARN), (10.0, ERROR)])
def test_each_limit_has_a_warning_and_an_error(silence, level):
    assert judge(HealthParams(), {"silence": silence})[0] == level


def test_a_limit_of_zero_is_never_reached():
    params = HealthParams(silence=(0.0, 0.0))
    assert judge(params, {"silence": 1e9}) == (OK, "running")


def test_the_worst_counts_and_all_are_told():
    level, text = judge(HealthParams(), {"silence": 3.0, "late_share": 0.6})
    assert level == ERROR
    assert text == "silence 3 reaches 2; late_share 0.6 reaches 0.5"


def test_the_real_time_factor_is_bad_when_it_is_low():
    params = HealthParams(slower=(0.9, 0.5))
    levels = [judge(params, {"real_time_factor": factor})[0] for factor in (1.0, 0.8, 0.4)]
    assert levels == [OK, WARN, ERROR]


def test_limits_are_checked():
    with pytest.raises(ParameterError, match="late_share"):
        HealthParams(late_share=(0.5, 2.0))
    with pytest.raises(ParameterError, match="silence must have 2 values"):
        HealthParams(silence=(1.0,))


def test_silence_counts_from_the_last_tick():
    meter = PeriodMeter()
    assert meter.silence is None
    meter.mark()
    time.sleep(0.01)
    assert 0.01 <= meter.silence < 5.0


def test_usage_is_of_this_process():
    meter = UsageMeter()
    end = time.perf_counter() + 0.05
    while time.perf_counter() < end:
        pass
    usage = meter.summary()
    assert usage["pid"] == os.getpid()
    assert usage["span_s"] >= 0.05
    assert usage["cpu_percent"] > 5.0
    assert usage["memory_mb"] > 1.0


def endpoint(pid, host=b"\x01\x02"):
    gid = [1, 15, *host, pid & 0xFF, (pid >> 8) & 0xFF, *([0] * 18)]
    return SimpleNamespace(endpoint_gid=gid)


def test_endpoints_of_dead_processes_here_do_not_count():
    dead = 30000
    while os.path.exists(f"/proc/{dead}"):
        dead += 1
    mine, gone, remote = endpoint(os.getpid()), endpoint(dead), endpoint(dead, b"\x09\x09")
    host = own_host([gone, mine])
    assert host == b"\x01\x02"
    assert low_pid(mine) == os.getpid() & 0xFFFF
    assert living([mine, gone, remote], host) == [mine, remote]


def test_a_process_that_ended_and_was_not_waited_for_is_dead():
    ended = subprocess.Popen(["true"])
    os.waitid(os.P_PID, ended.pid, os.WEXITED | os.WNOWAIT)
    assert os.path.exists(f"/proc/{ended.pid}")
    assert living([endpoint(ended.pid), endpoint(os.getpid())], b"\x01\x02") == [
        endpoint(os.getpid())
    ]
    ended.wait()


def test_without_an_endpoint_of_ours_all_count():
    gone = endpoint(30000)
    assert living([gone], own_host([])) == [gone]
