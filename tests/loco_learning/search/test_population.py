# SPDX-License-Identifier: Apache-2.0
"""The population engine: the same result whoever evaluates and whatever is interrupted."""

from __future__ import annotations

import contextlib
import os
import random
import signal
import subprocess
import sys
import time
from pathlib import Path

import numpy as np
import pytest

from loco_control.exceptions import LocoError, ParameterError
from loco_learning.jobs.journal import Journal
from loco_learning.search import evaluations
from loco_learning.search.evaluations import FILE, Evaluations
from loco_learning.search.population import PopulationParams, Score, minimise, seed_of

HERE = Path(__file__).resolve().parent
if str(HERE) not in sys.path:  # the processes of a pool get our path
    sys.path.append(str(HERE))

import toy_problems as toys  # noqa: E402

QUICK = PopulationParams(workers=0, evaluations=140, seed=5)


def record(folder):
    return (Path(folder) / FILE).read_bytes()


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory):
    """Folder and result of a search that nobody interrupted."""
    folder = tmp_path_factory.mktemp("undisturbed")
    return folder, minimise(toys.Valley(), QUICK, folder)


# ---- the search


def test_the_minimum_is_found_and_the_course_tells_how():
    seen = []
    found = minimise(toys.Valley(), QUICK.replace(evaluations=3000, target=1e-8), None, seen.append)
    np.testing.assert_allclose(found.x, 1.0, atol=1e-3)
    assert found.ended == "target reached" and found.generations == len(seen)
    assert found.named().keys() == {"a", "b", "c"}
    assert found.extra["length"] == pytest.approx(np.sqrt(3.0), abs=1e-2)
    bests = [p.best for p in seen]
    assert bests == sorted(bests, reverse=True)
    np.testing.assert_array_equal(found.course["best"], bests)
    assert seen[-1].sigma < 0.1 < seen[0].sigma
    assert seen[-1].evaluations == found.evaluations == len(seen) * 7
    assert seen[-1].rate > 0.0 and seen[-1].eta >= 0.0


def test_every_point_is_within_its_bounds(undisturbed):
    _, rows = evaluations.read(undisturbed[0])
    x = np.array([row["x"] for row in rows])
    assert np.all(x >= toys.Valley.low) and np.all(x <= toys.Valley.high)


def test_the_global_generator_of_numpy_has_no_say(undisturbed):
    np.random.seed(1)  # noqa: NPY002
    one = minimise(toys.Valley(), QUICK).x
    np.random.seed(2)  # noqa: NPY002
    np.testing.assert_array_equal(one, minimise(toys.Valley(), QUICK).x)
    np.testing.assert_array_equal(one, undisturbed[1].x)
    assert not np.array_equal(one, minimise(toys.Valley(), QUICK.replace(seed=6)).x)


def test_a_plateau_ends_a_search():
    problem = toys.Valley(floor=1.0)
    found = minimise(problem, QUICK.replace(evaluations=10**6, plateau=20))
    assert found.ended == "plateau: no improvement in 20 generations"
    assert found.value < 1.01


def test_a_report_or_a_question_stops_a_search(tmp_path):
    found = minimise(toys.Valley(), QUICK, tmp_path, lambda p: p.generation == 3)
    assert (found.ended, found.generations, found.evaluations) == ("stopped", 3, 21)
    answers = iter([False, False, True])
    found = minimise(toys.Valley(), QUICK, tmp_path, stop=lambda: next(answers))
    assert (found.ended, found.generations, found.evaluations) == ("stopped", 3, 24)
    resumed = minimise(toys.Valley(), QUICK, tmp_path)
    np.testing.assert_array_equal(resumed.x, minimise(toys.Valley(), QUICK).x)


# ---- whoever evaluates


@pytest.mark.parametrize("workers", [1, 2])
def test_the_number_of_workers_changes_nothing(undisturbed, tmp_path, workers):
    found = minimise(toys.Valley(), QUICK.replace(workers=workers), tmp_path)
    np.testing.assert_array_equal(found.x, undisturbed[1].x)
    assert record(tmp_path) == record(undisturbed[0])


def test_each_evaluation_has_a_seed_of_its_own(tmp_path):
    for workers in (0, 2):
        minimise(toys.Noisy(), QUICK.replace(workers=workers), tmp_path / str(workers))
    assert record(tmp_path / "0") == record(tmp_path / "2")
    _, rows = evaluations.read(tmp_path / "0")
    seeds = [row["extra"]["seed"] for row in rows]
    assert len(set(seeds)) == len(seeds)
    assert seeds[8] == seed_of(5, 1, 1)


def wait_for(condition, seconds=30.0):
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end, "waited in vain"
        time.sleep(0.01)


def start(*arguments):
    command = [sys.executable, str(HERE / "toy_problems.py"), *map(str, arguments)]
    return subprocess.Popen(command, stdout=subprocess.PIPE, text=True, start_new_session=True)


@pytest.mark.parametrize("workers", [0, 2])
def test_a_killed_search_goes_on_to_the_same_end(undisturbed, tmp_path, workers):
    """SIGKILL at a random moment, twice: the record is the same, byte for byte."""
    size = 0
    for _ in range(2):
        killed = start(tmp_path, workers, "", 0.01, QUICK.evaluations)
        wanted = size + random.randint(1, len(record(undisturbed[0])) // 3)
        path = tmp_path / FILE
        wait_for(lambda: path.is_file() and path.stat().st_size > wanted)  # noqa: B023
        os.killpg(killed.pid, signal.SIGKILL)
        killed.communicate()
        size = path.stat().st_size
        assert size < len(record(undisturbed[0]))
        with path.open("a") as file:  # and a line that was not finished
            file.write('{"generation": 3, "ind')
    found = minimise(toys.Valley(), QUICK.replace(workers=workers), tmp_path)
    np.testing.assert_array_equal(found.x, undisturbed[1].x)
    assert record(tmp_path) == record(undisturbed[0])


def test_a_finished_search_is_read_not_run(undisturbed, monkeypatch):
    monkeypatch.setattr(toys.Valley, "__call__", None)
    again = minimise(toys.Valley(), QUICK, undisturbed[0])
    np.testing.assert_array_equal(again.x, undisturbed[1].x)
    assert again.ended == undisturbed[1].ended


def test_a_search_can_be_given_more_evaluations(undisturbed, tmp_path):
    minimise(toys.Valley(), QUICK.replace(evaluations=50), tmp_path)
    minimise(toys.Valley(), QUICK, tmp_path)
    assert record(tmp_path) == record(undisturbed[0])


def test_workers_end_with_a_killed_search(tmp_path):
    killed = start(tmp_path, 2, "", 0.05, 10**6)
    wait_for(lambda: (tmp_path / FILE).is_file() and len(record(tmp_path)) > 2000)
    children = subprocess.run(
        ["ps", "-o", "pid=", "--ppid", str(killed.pid)], capture_output=True, text=True, check=True
    ).stdout.split()
    assert len(children) >= 2
    killed.kill()
    killed.communicate()
    wait_for(lambda: not any(Path(f"/proc/{pid}/exe").exists() for pid in children))


# ---- failures are scores


@pytest.mark.parametrize("workers", [0, 2])
def test_a_failing_evaluation_is_a_score_with_a_reason(tmp_path, workers):
    options = QUICK.replace(workers=workers, evaluations=400, failure=5e4)
    seen = []
    found = minimise(toys.Broken(), options, tmp_path, seen.append)
    _, rows = evaluations.read(tmp_path)
    reasons = {row["reason"] for row in rows if row["value"] == 5e4}
    assert {"ZeroDivisionError: too far left", "exploded", "the score is nan"} == reasons
    assert found.reason == "" and found.value < 1.0
    failed = sum(bool(row["reason"]) for row in rows)
    assert sum(p.failures for p in seen) == failed > 0
    assert seen[0].reason in reasons


def test_a_killed_worker_is_replaced_and_its_evaluation_repeated(tmp_path):
    options = QUICK.replace(workers=2, evaluations=28)
    (tmp_path / "marks").mkdir()
    minimise(toys.Deadly(tmp_path / "marks"), options, tmp_path)
    _, rows = evaluations.read(tmp_path)
    assert len(rows) == 28
    for row in rows:
        died = row["x"][0] > 1.0
        assert row["reason"] == ("its process died, exit code -9" if died else "")
        if 0.0 < row["x"][0] < 1.0:
            assert row["value"] == toys.Valley()(np.array(row["x"])).value
    assert any(row["x"][0] > 0.0 for row in rows)


# ---- a dask cluster


def test_a_cluster_gives_the_same_and_the_death_of_a_worker_loses_nothing(
    undisturbed, cluster, tmp_path
):
    address, workers = cluster
    options = QUICK.replace(scheduler=address)
    found = minimise(toys.Valley(), options, tmp_path / "whole")
    np.testing.assert_array_equal(found.x, undisturbed[1].x)
    assert record(tmp_path / "whole") == record(undisturbed[0])

    def kill_one(progress):
        if progress.generation == 5:
            workers[0].kill()

    minimise(toys.Valley(0.02), options, tmp_path / "one", kill_one)
    assert record(tmp_path / "one") == record(undisturbed[0])


def test_an_unreachable_scheduler_gets_one_clear_message(tmp_path, monkeypatch):
    monkeypatch.setattr("loco_learning.jobs.cluster.CONNECT_SECONDS", 0.5)
    with pytest.raises(ParameterError, match="no dask scheduler answers at 'tcp://127.0.0.1:9'"):
        minimise(toys.Valley(), QUICK.replace(scheduler="tcp://127.0.0.1:9"), tmp_path)
    for address in ("tcp://10.0.0.9:8786", "ws://cluster:8786", "tcp://127.0.0.1.example.org:1"):
        with pytest.raises(ParameterError, match="is of another machine; .*tls://"):
            minimise(toys.Valley(), QUICK.replace(scheduler=address), tmp_path)
    with pytest.raises(ParameterError, match="no dask scheduler answers at 'nonsense'"):
        minimise(toys.Valley(), QUICK.replace(scheduler="nonsense"), tmp_path)


# ---- mistakes


def rewritten(folder, *rows):
    """Write a record of these rows with right check sums; returns its text."""
    with contextlib.closing(Journal(folder / FILE, rows[0])) as journal:
        for row in rows[1:]:
            journal.append(row)
    return (folder / FILE).read_text()


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"format": 3}, "belongs to other work: format is 3 there, 2 here"),
        ({"kind": "log"}, "belongs to other work: kind is 'log' there"),
        ({"sigma": 0.2}, "belongs to other work: sigma is 0.2 there, 0.3 here"),
        ({"problem": {"gait": "walk"}}, "belongs to other work: problem.gait is"),
    ],
)
def test_a_record_of_something_else_is_refused_and_left_alone(
    undisturbed, tmp_path, change, message
):
    header, rows = evaluations.read(undisturbed[0])
    text = rewritten(tmp_path, {**header, **change}, *rows)
    with pytest.raises(ParameterError, match=message) as caught:
        minimise(toys.Valley(), QUICK, tmp_path)
    assert isinstance(caught.value, LocoError) and "\n" not in str(caught.value)
    assert (tmp_path / FILE).read_text() == text


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("hello\n", "line 1, is broken: it has no check sum"),
        ("[1]\n", "line 1, is broken"),
        ('{"kind": "optimisation"}\n', "line 1, is broken: it has no check sum, as .* older"),
    ],
)
def test_a_file_that_is_no_record_is_refused(tmp_path, text, message):
    (tmp_path / FILE).write_text(text)
    with pytest.raises(ParameterError, match=message):
        minimise(toys.Valley(), QUICK, tmp_path)


def test_a_broken_line_is_named(undisturbed, tmp_path):
    lines = record(undisturbed[0]).decode().splitlines()
    for broken in (lines[4][:-9], lines[6]):
        (tmp_path / FILE).write_text("\n".join([*lines[:4], broken, *lines[5:]]) + "\n")
        with pytest.raises(ParameterError, match="line 5, is broken"):
            evaluations.read(tmp_path)
    with pytest.raises(LocoError, match="there is no record"):
        evaluations.read(tmp_path / "nowhere")


def test_points_that_another_search_drew_are_refused(undisturbed, tmp_path):
    header, rows = evaluations.read(undisturbed[0])
    rows[3]["x"][0] += 1e-9
    rewritten(tmp_path, header, *rows)
    with pytest.raises(ParameterError, match="generation 0 of the record was not drawn by"):
        minimise(toys.Valley(), QUICK, tmp_path)


def test_two_searches_cannot_write_the_same_record(undisturbed, tmp_path):
    header, _ = evaluations.read(undisturbed[0])
    first = Evaluations(tmp_path / FILE, header)
    first.append(0, 0, 0.3, np.zeros(3), Score(1.0))
    with pytest.raises(ParameterError, match="another process is writing"):
        Evaluations(tmp_path / FILE, header)
    first.close()
    assert len(Evaluations(tmp_path / FILE, header).rows) == 1


class Wrong(toys.Valley):
    """The valley with something wrong."""

    def __init__(self, **wrong):
        super().__init__()
        vars(self).update(wrong)


@pytest.mark.parametrize(
    ("wrong", "message"),
    [
        ({"low": (-2.0, -2.0, 3.0)}, "bounds of c must be finite and low < high, got 3.0, 3.0"),
        ({"high": (2.0, np.inf, 3.0)}, "bounds of b must be finite"),
        ({"start": (5.0, 0.0, 0.0)}, r"start of a must be in its bounds \[-2, 2\], got 5"),
        ({"names": ("a", "b")}, "2 or more names, with bounds and start for each; got 2"),
    ],
)
def test_wrong_bounds_get_one_clear_message(tmp_path, wrong, message):
    with pytest.raises(ParameterError, match=message):
        minimise(Wrong(**wrong), QUICK, tmp_path)
    assert not list(tmp_path.iterdir())


def test_a_problem_that_cannot_travel_is_refused():
    problem = toys.Valley()
    problem.hook = lambda: None
    with pytest.raises(ParameterError, match="cannot be sent to other processes"):
        minimise(problem, QUICK.replace(workers=2))
