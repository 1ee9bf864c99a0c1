# SPDX-License-Identifier: Apache-2.0
"""`loco reproduce msd`: arguments, verdicts on the terminal, page."""

import dataclasses

import pytest

from loco_bringup import cli
from loco_learning import msd_jobs


def call(*arguments: str) -> int:
    with pytest.raises(SystemExit) as caught:
        cli.main(["reproduce", *arguments])
    return caught.value.code


@pytest.mark.parametrize(
    ("arguments", "text"),
    [
        (["msb"], "no thing to reproduce named 'msb' (did you mean 'msd'?)"),
        (["msd", "--preset", "code"], "available: author_code, thesis"),
        (["msd", "--workers", "0"], "workers must be at least 1, got 0"),
    ],
)
def test_mistakes_are_one_line(arguments, text, capsys):
    assert call(*arguments) == 2
    assert text in capsys.readouterr().err


def test_verdicts_are_printed_and_the_page_is_written(tmp_path, monkeypatch, capsys):
    quick = dataclasses.replace(
        msd_jobs.PLANS["quick"], nodes=(5,), repetitions=1, budget=(0, 10), omega_nodes=(),
        powers=(), loop_repetitions=0, regularisations=(), noises=(),
    )  # fmt: skip
    monkeypatch.setitem(msd_jobs.PLANS, "quick", quick)
    assert call("msd", "--quick", "--workers", "1", "--out", str(tmp_path)) == 0
    text = capsys.readouterr().out
    assert "6.5  agrees" in text
    assert "not decided" in text
    assert (tmp_path / "README.md").is_file()
    assert (tmp_path / "runs" / "nodes_5_0.npz").is_file()
