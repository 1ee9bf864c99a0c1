# SPDX-License-Identifier: Apache-2.0
"""Damaged input for every parser: one error of ours each; and the search sees what is planted."""

import json
import os
import signal
import subprocess
import sys
import time

import numpy as np
import pytest

from loco_bringup.graph.processes import _environment
from loco_control.exceptions import GraphError, NameUnknownError
from loco_learning.gap.recordings import mapping
from loco_workshop.fuzz import fuzz
from loco_workshop.fuzz.targets import MAPPING, TARGETS, Target

INPUTS = 60  # of each target; `loco fuzz` runs more
# Messages pass through seven readers, of which each refuses those of the others; a bag is read
# without its metadata.yaml where that is broken, and a search begins anew.
LENIENT = ("messages", "metadata", "journal", "journal_rows")
FINDS = {  # inputs that were tracebacks once
    "node_set": [b"table: {a: 1}\nnodes: []\n", b"table: [hyq]\nnodes: []\n", b"nodes: 3\n"],
    "study": [b"variants: {a: hyq_short}\nfigures: [[a]]\n", b"variants: {a: [1]}\n"],
    "robot": [
        b"urdf: tigrillo.urdf\njoints: [{a: 1}]\n",
        b"urdf: '" + b"9" * 400 + b"'\njoints: [a]\n",
    ],
    "experiment": [b"extends: hyq_short\nrobot: 3\n", b"kind: joint\nrobot: 3\n"],
    "model": [b"format: 1\nrobot: tigrillo\neffects: [3]\n", b"format: 1\nrobot: [tigrillo]\n"],
}


@pytest.mark.parametrize("name", TARGETS)
def test_the_inputs_to_begin_with_are_right(name):
    seeds = TARGETS[name].seeds()
    assert seeds
    assert {fuzz.outcome(TARGETS[name], data)[0] for data in seeds} == {""}


@pytest.mark.parametrize("name", TARGETS)
def test_damaged_input_is_one_error_of_ours(name):
    refused = 0
    for data in fuzz.inputs(TARGETS[name], [5, len(name)], INPUTS):
        kind, why = fuzz.outcome(TARGETS[name], data)
        assert kind in ("", "refused"), f"{data!r}\n{why}"
        refused += kind == "refused"
    assert refused > INPUTS / 4 or name in LENIENT


@pytest.mark.parametrize(("name", "data"), [(n, d) for n, each in FINDS.items() for d in each])
def test_what_was_found_once_stays_mended(name, data):
    kind, why = fuzz.outcome(TARGETS[name], data)
    assert kind == "refused", why


def test_equal_seeds_damage_equally():
    chosen = TARGETS["mapping"]
    first, again, other = (list(fuzz.inputs(chosen, [s], 50)) for s in (1, 1, 2))
    assert first == again != other
    assert len(set(first)) > 40


def stuck(data, folder):
    end = time.monotonic() + 30.0
    while time.monotonic() < end:
        pass


def planted(run):
    return Target(lambda: [b"a"], run)


def test_each_kind_of_find_is_seen(monkeypatch):
    monkeypatch.setattr(fuzz, "LIMIT", 1)
    handler = signal.getsignal(signal.SIGPROF)

    def lines(data, folder):
        raise GraphError("one\ntwo")

    assert fuzz.outcome(planted(lambda data, folder: {}["a"]), b"")[0] == "traceback"
    assert fuzz.outcome(planted(lines), b"")[0] == "traceback"
    assert fuzz.outcome(planted(stuck), b"")[0] == "no end"
    assert fuzz.outcome(planted(lambda data, folder: None), b"")[0] == ""
    assert signal.getsignal(signal.SIGPROF) is handler


@pytest.mark.parametrize(
    ("end", "kind", "why"),
    [("os.kill(os.getpid(), 11)", "crash", "-11"),
     ("signal.signal(27, 1); threading.Event().wait()", "no end", "no end")],
)  # fmt: skip
def test_a_parser_that_ends_the_process_or_hears_no_signal_is_found_with_its_input(
    end, kind, why, tmp_path, monkeypatch
):
    """The child is a process of its own, so it is given the planted target by its environment."""
    (tmp_path / "sitecustomize.py").write_text(
        "import os, signal, threading\n"
        "from loco_workshop.fuzz import targets\n"
        "def die(data, folder):\n"
        f"    if len(data) > 3: {end}\n"
        "targets.TARGETS['planted'] = targets.Target(lambda: [b'abc'], die)\n"
    )
    paths = [str(tmp_path), os.environ.get("PYTHONPATH", "")]
    monkeypatch.setenv("PYTHONPATH", ":".join(filter(None, paths)))
    monkeypatch.setattr(fuzz, "STUCK", 4.0)
    found = fuzz.run_batch("planted", [0], 50, tmp_path / "finds")
    assert found[kind] == 1
    (path,) = (tmp_path / "finds").glob("*.bin")
    assert len(path.read_bytes()) > 3
    assert path.with_suffix(".txt").read_text() == why


def test_the_command_counts_and_keeps_nothing_where_nothing_is_found(tmp_path):
    done = subprocess.run(
        [sys.executable, "-m", "loco_bringup.cli.main", "fuzz", "mapping", "--minutes", "0.01",
         "--out", str(tmp_path / "out")],
        capture_output=True, text=True, env=_environment(), timeout=200,
    )  # fmt: skip
    assert done.returncode == 0, done.stdout + done.stderr
    rows = json.loads((tmp_path / "out/fuzz.json").read_text())
    assert rows["mapping"]["inputs"] >= fuzz.BATCH
    assert 0 < rows["mapping"]["refused"] < rows["mapping"]["inputs"]
    assert not list((tmp_path / "out").glob("*/*.bin"))


def test_a_target_that_is_none_is_one_line(tmp_path):
    with pytest.raises(NameUnknownError, match="no target named 'elbow'.*experiment"):
        fuzz.fuzz(["elbow"], 1.0, tmp_path)


def test_the_mapping_to_begin_with_maps(tmp_path):
    (tmp_path / "mapping.yaml").write_bytes(MAPPING)
    assert len(mapping.load(tmp_path).columns) == 2
    assert np.isfinite(mapping.load(tmp_path).time_unit)
