# SPDX-License-Identifier: Apache-2.0
"""A calibration in a child process: the same result, and an end on request."""

import copy
import functools
import os
import time

import numpy as np
import pytest

from loco_learning.calibration.params import CalibrationParams
from loco_learning.calibration.recording import Recording
from loco_learning.calibration.worker import Done, Failed, Progress, Started, Worker
from loco_sim.plant import model as models
from loco_sim.robot.robot import load

FREQUENCY, RATE = 1.0, 100.0


def recording(seconds=5.0):
    """Hips that swing, and knees that swing with them; a made-up robot will do."""
    robot = load("tigrillo")
    t = np.arange(round(seconds * RATE)) / RATE
    wave = np.sin(2 * np.pi * FREQUENCY * t)
    driven = tuple(robot.joints[i] for i in robot.driven)
    command = np.tile(0.3 * wave[:, None], len(driven))
    q = 0.6 + 0.1 * np.tile(wave[:, None], len(robot.joints))
    return Recording("made up", t, command, q, driven, robot.joints)


def options(**changes):
    return CalibrationParams(skip=0.0, periods=1, population=2, generations=2).replace(**changes)


def until(worker, kind, timeout=60.0):
    """All news up to the first of a kind."""
    heard, end = [], time.monotonic() + timeout
    while not any(isinstance(n, (kind, Failed)) for n in heard):
        assert time.monotonic() < end, heard
        heard += worker.news()
        time.sleep(0.01)
    return heard


@pytest.fixture
def start():
    made = []

    def make(*arguments):
        made.append(Worker(*arguments))
        return made[-1]

    yield make
    for worker in made:
        worker.close()


def test_it_tells_of_every_generation_and_of_the_best_model(start):
    heard = until(start(recording(), "tigrillo", options()), Done)
    assert isinstance(heard[0], Started)
    generations = [n.generation for n in heard if isinstance(n, Progress)]
    assert [g.index for g in generations] == [1, 2]
    assert isinstance(heard[-1], Done)
    found = models.loads(heard[-1].model)
    assert found.robot == "tigrillo"
    assert any("stiffness" in name for name in found.overrides)
    for news in heard:
        if isinstance(news, Progress) and news.model:
            assert news.generation.best < heard[0].before


def test_cancel_ends_it_early_with_what_there_is(start):
    read = functools.partial(copy.copy, recording())  # read in the child, as a bag is
    worker = start(read, "tigrillo", options(generations=10_000, patience=10_000))
    until(worker, Progress)
    worker.cancel()
    fit = until(worker, Done)[-1].fit
    assert fit.ended == "cancelled"
    assert fit.history[-1].index < 1000


def test_a_mistake_and_a_death_are_told_in_one_line(start):
    failed = until(start(recording(0.5), "tigrillo", options()), Done)[-1]
    assert "\n" not in failed.text
    assert "periods" in failed.text or "short" in failed.text


def test_a_death_is_told_and_nothing_is_left(start):
    worker = start(recording(), "tigrillo", options(generations=10_000))
    until(worker, Started)
    os.kill(worker.pid, 9)
    assert "died with exit code -9" in until(worker, Failed)[-1].text
    worker.close()
    with pytest.raises(ProcessLookupError):
        os.kill(worker.pid, 0)
