# SPDX-License-Identifier: Apache-2.0
"""A task in a process of its own: progress, result, one line for a mistake and for a death."""

from __future__ import annotations

import os
import signal
import sys
import time
from functools import partial
from pathlib import Path

import pytest

from loco_learning.gap.worker import Done, Failed, Progress, Worker

HERE = str(Path(__file__).resolve().parent)
if HERE not in sys.path:  # the child process gets our path
    sys.path.append(HERE)

import toy_tasks  # noqa: E402


def wait(worker, kind, timeout=60.0):
    """News up to the first of a kind."""
    found, end = [], time.monotonic() + timeout
    while not any(isinstance(news, kind) for news in found):
        assert time.monotonic() < end, found
        found += worker.news()
        time.sleep(0.01)
    return found


@pytest.fixture
def start():
    made = []

    def make(task):
        made.append(Worker(task))
        return made[-1]

    yield make
    for worker in made:
        worker.close()


def test_progress_and_result_come_in_order(start):
    worker = start(partial(toy_tasks.call, 0.5, "fitting", "backlash"))
    news = wait(worker, Done)
    assert news == [Progress(0.5, "fitting", "backlash"), Done("backlash")]
    assert worker.news() == []


def test_a_mistake_is_one_line(start):
    (news,) = wait(start(partial(toy_tasks.robot, "tiger")), Failed)
    assert "tigrillo" in news.text and "\n" not in news.text


def test_a_death_is_told_and_nothing_is_left(start):
    worker = start(partial(toy_tasks.sleep, 60.0))
    os.kill(worker.pid, signal.SIGKILL)
    (news,) = wait(worker, Failed)
    assert "died" in news.text
    worker.close()
    with pytest.raises(ProcessLookupError):
        os.kill(worker.pid, 0)
