# SPDX-License-Identifier: Apache-2.0
"""The same results for any number of processes, whatever dies, hangs or raises."""

from __future__ import annotations

import os
import sys
import time
from pathlib import Path

import pytest

from loco_control.exceptions import GraphError, LocoError, ParameterError
from loco_learning.jobs import pool
from loco_learning.jobs.pool import Failure

HERE = Path(__file__).resolve().parent
if str(HERE) not in sys.path:  # the processes of a pool get our path
    sys.path.append(str(HERE))

import toy_jobs as toys  # noqa: E402


def alive(pid):
    try:
        stat = Path(f"/proc/{pid}/stat").read_text()
    except FileNotFoundError:
        return False
    return stat.rsplit(")", 1)[1].split()[0] != "Z"


@pytest.mark.parametrize("workers", [0, 1, 2, 3])
def test_results_are_the_same_and_in_order_for_any_number_of_processes(workers):
    values = [(v, 0.1 if v == 0 else 0.0) for v in range(7)]  # the first is done last
    with pool.start(toys.scaled, (0.1,), workers) as jobs:
        assert list(jobs.ordered(values)) == [0.1 * v for v, _ in values]
        assert dict(jobs.results(values)) == {i: 0.1 * v for i, (v, _) in enumerate(values)}
        assert list(jobs.ordered([])) == []


def test_results_arrive_as_they_are_done():
    with pool.start(toys.scaled, (1,), 2) as jobs:
        list(jobs.ordered([(0,), (0,)]))  # both processes have started
        assert [index for index, _ in jobs.results([(1, 2.0), (2, 0.0)])] == [1, 0]


def test_a_killed_process_is_replaced_and_its_job_tried_again(tmp_path):
    with pool.start(toys.dies, workers=2) as jobs:
        once, twice = (tmp_path / "once", 1), (tmp_path / "twice", 2)
        outcomes = dict(jobs.outcomes([once, twice, (tmp_path / "never", 0)]))
    assert outcomes[0] == 2 and outcomes[2] == 1
    assert outcomes[1] == Failure("its process died, exit code -9")
    assert (tmp_path / "twice").read_text() == ".."
    with pool.start(toys.dies, workers=1) as jobs:
        with pytest.raises(GraphError, match="its process died, exit code -9"):
            list(jobs.ordered([(tmp_path / "always", 9)]))


def test_a_job_that_hangs_is_ended_at_its_limit_and_the_others_are_done():
    began = time.monotonic()
    with pool.start(toys.pid_of, workers=2, limit=4.0) as jobs:
        outcomes = dict(jobs.outcomes([(0.0,), (60.0,), (0.0,)]))
        assert outcomes[1] == Failure("it took more than 4 s")
        assert all(isinstance(outcomes[i], int) for i in (0, 2))
        assert len(list(jobs.ordered([(0.0,), (0.0,)]))) == 2
    assert 4.0 < time.monotonic() - began < 30.0


@pytest.mark.parametrize("workers", [0, 1])
def test_an_error_of_a_job_is_raised_here(workers):
    with pool.start(toys.fails, workers=workers) as jobs:
        with pytest.raises(ZeroDivisionError, match="too far left") as caught:
            list(jobs.ordered([("other",)]))
        traces = str(caught.value.__cause__) + str(caught.traceback[-1])
        assert "toy_jobs.py" in traces
        with pytest.raises(LocoError, match="no gait named 'trott'.*available: trot, walk"):
            list(jobs.ordered([("name",)]))
        ((_, failure),) = jobs.outcomes([("other",)])
        assert failure.reason == "ZeroDivisionError: too far left"


def test_a_result_that_cannot_be_sent_is_a_failure():
    with pool.start(toys.fails, workers=1) as jobs:
        ((_, failure),) = jobs.outcomes([("result",)])
    assert failure.reason.startswith("its result cannot be sent: ")


def test_a_function_that_cannot_be_sent_is_refused():
    with pytest.raises(ParameterError, match="cannot be sent to other processes"):
        pool.start(lambda: 1, workers=1)


def test_jobs_that_nobody_waits_for_are_ended_and_the_pool_goes_on():
    with pool.start(toys.pid_of, workers=2) as jobs:
        results = jobs.results([(0.0,), (60.0,), (60.0,)])
        _, first = next(results)
        results.close()
        began = time.monotonic()
        assert len(list(jobs.ordered([(0.0,)] * 3))) == 3
        assert time.monotonic() - began < 30.0
        assert first != os.getpid()
    assert not alive(first)


def test_no_process_is_left_after_an_error_or_a_close():
    with pytest.raises(KeyboardInterrupt):
        with pool.start(toys.pid_of, workers=2) as jobs:
            pids = list(jobs.ordered([(0.5,), (0.5,)]))
            assert all(alive(pid) for pid in pids)
            for _ in jobs.results([(60.0,), (0.0,)]):
                raise KeyboardInterrupt
    assert len(set(pids)) == 2 and not any(alive(pid) for pid in pids)
