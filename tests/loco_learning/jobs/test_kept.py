# SPDX-License-Identifier: Apache-2.0
"""What a killed command had done is there, and nothing else that its journal may hold."""

from __future__ import annotations

import base64
import json
import os
import pickle
from contextlib import closing
from dataclasses import dataclass

import numpy as np
import pytest

from loco_control.exceptions import ParameterError
from loco_learning.jobs import journal, kept, pool, values
from loco_learning.jobs.journal import Journal
from loco_learning.jobs.kept import Memory, digest

HEADER = {"kind": "test", "format": 1, "what": "rows"}
ROWS = [{"key": i, "x": [0.1 * i, float("inf")], "text": "é\n"} for i in range(5)]


@pytest.fixture
def written(tmp_path):
    path = tmp_path / "work.jsonl"
    with closing(Journal(path, HEADER)) as one:
        for row in ROWS:
            one.append(row)
    return path


def test_a_journal_cut_anywhere_goes_on_to_the_same_bytes(written):
    whole = written.read_bytes()
    for end in range(0, len(whole), 7):
        written.write_bytes(whole[:end])
        with closing(Journal(written, HEADER)) as one:
            assert one.rows == ROWS[: len(one.rows)]
            for row in ROWS[len(one.rows) :]:
                one.append(row)
        assert written.read_bytes() == whole


def test_a_changed_byte_of_a_whole_line_is_seen(written):
    whole = bytearray(written.read_bytes())
    for at in range(0, len(whole) - 1, 11):
        changed = bytearray(whole)
        changed[at] ^= 1
        written.write_bytes(changed)
        with pytest.raises(ParameterError, match=r"work.jsonl, line \d, is broken"):
            Journal(written, HEADER)
        assert written.read_bytes() == changed


def test_a_journal_of_other_work_is_refused_or_begun_anew(written, caplog):
    with pytest.raises(ParameterError, match="belongs to other work: what is 'rows' there"):
        Journal(written, {**HEADER, "what": "columns"})
    with closing(Journal(written, {**HEADER, "what": "columns"}, new=True)) as one:
        assert one.rows == []
    assert "work that was begun is done anew" in caplog.text
    assert journal.read(written)[0]["what"] == "columns"


def test_a_row_without_room_leaves_the_file_as_it_was(written, monkeypatch):
    before = written.read_bytes()
    with closing(Journal(written, HEADER)) as one:
        real = one._file.write
        monkeypatch.setattr(one, "_file", Full(one._file, real))
        with pytest.raises(OSError, match="no room"):
            one.append({"key": 9})
    assert written.read_bytes() == before


class Full:
    """A file on a disk that takes ten bytes more."""

    def __init__(self, file, write):
        self.fileno, self.close, self._write, self._calls = file.fileno, file.close, write, 0

    def write(self, data):
        self._calls += 1
        if self._calls > 1:
            raise OSError(28, "no room")
        return self._write(data[:10])


@dataclass(frozen=True, eq=False)
class Answer:
    """Result of a job."""

    value: np.ndarray
    of: str = ""


CALLS: list[float] = []  # arguments of each call of `work`


@pytest.fixture(autouse=True)
def _no_calls_yet():
    CALLS.clear()


def work(scale, x):
    CALLS.append(x)
    return Answer(scale * np.arange(3.0) + x, f"{x}")


def search(memory, scale=2.0):
    """Results of two places, the later of which depends on the first."""
    with memory:
        first = list(memory.keeping(pool.start(work, (scale,))).ordered([(1.0,), (2.0,), (1.0,)]))
        jobs = [(float(first[0].value[1]),)]
        return first + list(memory.keeping(pool.start(work, (scale,))).ordered(jobs))


def test_a_search_begun_again_runs_only_what_is_missing(tmp_path):
    path = tmp_path / "search.jsonl"
    wanted = search(Memory(path, (1,), (Answer,)))
    assert (len(CALLS), path.exists()) == (4, False)  # a search that is done leaves nothing
    for broken in range(1, 4):
        path.unlink(missing_ok=True)
        CALLS.clear()

        class Killed(Memory):
            def keep(self, key, result, at=broken):
                if len(CALLS) > at:
                    raise SystemExit
                return super().keep(key, result)

        with pytest.raises(SystemExit):
            search(Killed(path, (1,), (Answer,)))
        assert path.exists()
        CALLS.clear()
        found = search(Memory(path, (1,), (Answer,)))
        assert len(CALLS) == (1 if broken > 1 else 2)  # the third job is the first again
        for a, b in zip(found, wanted, strict=True):
            assert a.of == b.of and a.value.tobytes() == b.value.tobytes()


def test_results_of_other_inputs_are_not_taken(tmp_path, caplog):
    path = tmp_path / "search.jsonl"
    with pytest.raises(SystemExit), Memory(path, (1,), (Answer,)) as memory:
        next(memory.keeping(pool.start(work, (2.0,))).ordered([(1.0,)]))
        raise SystemExit
    search(Memory(path, (2,), (Answer,)))
    assert len(CALLS) == 5
    assert "belongs to other work: inputs is" in caplog.text


def killed(path, inputs=(1,)):
    """Memory of a search that was killed after its first result."""
    with pytest.raises(SystemExit), Memory(path, inputs, (Answer,)) as memory:
        next(memory.keeping(pool.start(work, (2.0,))).ordered([(1.0,)]))
        raise SystemExit


@pytest.mark.parametrize(
    "result",
    [
        {"is": "Memory", "of": {}}, {"is": "Answer", "of": {"value": 1}}, {"is": "Answer"},
        {"is": "array", "of": ["|O", [1], "C", ""]}, {"is": "array", "of": ["<f8", [2**40], "C", ""]},
        {"is": "array", "of": ["<f8", [-1], "C", ""]}, {"is": "array", "of": ["<f8", [1], "C", "!"]},
        {"is": "array", "of": [3]}, {"is": "dict", "of": [[[], 1]]}, {"is": ["tuple"], "of": []}, {},
    ],
)  # fmt: skip
def test_a_journal_can_make_nothing_but_results(tmp_path, result):
    """Somebody else's journal must not run what it likes, nor fill the memory."""
    path = tmp_path / "search.jsonl"
    killed(path)
    header, rows, _ = journal.read(path, dict)
    path.unlink()
    with closing(Journal(path, header)) as one:
        one.append({**rows[0], "result": result})
    with pytest.raises(ParameterError, match="search.jsonl is broken, remove it: it holds no"):
        search(Memory(path, (1,), (Answer,)))


def test_a_journal_of_an_older_version_is_told_and_begun_anew(tmp_path, caplog):
    path = tmp_path / "search.jsonl"
    killed(path)
    header, _, _ = journal.read(path, dict)
    path.unlink()
    with closing(Journal(path, {**header, "format": 1})) as one:
        one.append({"key": "a", "result": base64.b64encode(pickle.dumps(print)).decode()})
    search(Memory(path, (1,), (Answer,)))
    assert len(CALLS) == 5
    (line,) = caplog.messages
    assert "search.jsonl belongs to other work: format is 1 there, 4 here" in line


@pytest.mark.parametrize("row", [{"key": 3, "result": 1}, {"result": 1}, {"key": "a"}, [1]])
def test_rows_of_another_kind_are_told_and_begun_anew(tmp_path, row, caplog):
    path = tmp_path / "search.jsonl"
    killed(path)
    line = journal._line(row) if isinstance(row, dict) else b"[1]\n"
    path.write_bytes(path.read_bytes() + line)
    search(Memory(path, (1,), (Answer,)))
    assert len(CALLS) == 5 and "search.jsonl, line 3, is broken" in caplog.messages[0]


def test_a_pipe_in_the_place_of_a_journal_is_not_waited_for(tmp_path):
    os.mkfifo(tmp_path / "search.jsonl")
    with pytest.raises(ParameterError, match="is no file"):
        Memory(tmp_path / "search.jsonl", (1,), (Answer,))


def test_a_journal_that_is_full_keeps_what_it_has(tmp_path, monkeypatch):
    path = tmp_path / "search.jsonl"
    wanted = search(Memory(path, (1,), (Answer,)))
    monkeypatch.setattr(kept, "LIMIT", 1000)
    memory = Memory(path, (1,), (Answer,))
    jobs = [(float(x),) for x in range(50)]
    with pytest.raises(SystemExit), memory:
        list(memory.keeping(pool.start(work, (2.0,))).ordered(jobs))
        raise SystemExit
    assert 100 < path.stat().st_size < 1500
    CALLS.clear()
    memory = Memory(path, (1,), (Answer,))
    with memory:
        found = list(memory.keeping(pool.start(work, (2.0,))).ordered(jobs))
    assert 40 < len(CALLS) < 50
    assert [a.of for a in found] == [f"{float(x)}" for x in range(50)]
    assert found[1].value.tobytes() == wanted[0].value.tobytes()


VALUES = [
    None, True, 3, 2**80, -0.0, float("nan"), float("-inf"), 0.1, "é\n", [], (), {}, [1, (2.0, "a")],
    {"a": (1,), 3: None, (1, 2): "b"}, np.float64(0.1), np.int32(3), np.bool_(True),
    np.arange(6.0).reshape(2, 3), np.asfortranarray(np.arange(6.0).reshape(2, 3)),
    np.zeros((0, 3)), np.array(3.0), np.array([np.nan, -0.0, np.inf], "<f4"), np.arange(9)[::2],
    Answer(np.arange(2.0), "a"), (Answer(np.zeros(1)), [Answer(np.ones(1))]),
]  # fmt: skip


@pytest.mark.parametrize("value", VALUES, ids=range(len(VALUES)))
def test_values_come_back_with_types_and_bytes(value):
    again = values.load(json.loads(json.dumps(values.dump(value))), (Answer,))
    assert type(again) is type(value)
    assert digest(again) == digest(value)
    if isinstance(value, np.ndarray):
        assert again.flags.f_contiguous == np.ascontiguousarray(value).flags.f_contiguous or (
            value.flags.f_contiguous
        )
        assert again.flags.writeable


@pytest.mark.parametrize("value", [print, np.array(["a"]), {1, 2}, b"a", Memory])
def test_other_values_are_no_results(value):
    with pytest.raises(TypeError, match="cannot be kept"):
        values.dump([value])


def test_digests_tell_values_apart_and_nothing_else():
    values = [1, 1.0, "1", b"1", None, True, [1], (1,), {"a": 1}, {"a": 1.0}, np.ones(1),
              np.ones(2), np.ones(1, np.float32), np.float64(1.0), Answer(np.ones(1)),
              Answer(np.ones(1), "a"), search, work, [[1], 2], [1, [2]]]  # fmt: skip
    assert len({digest(v) for v in values}) == len(values)
    assert digest(np.ones((4, 4))[::2]) == digest(np.ones((2, 4)))
    with pytest.raises(TypeError, match="no digest of a object"):
        digest(object())
