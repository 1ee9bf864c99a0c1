# SPDX-License-Identifier: Apache-2.0
"""The tables in ``docs/`` are those of the code."""

import pytest

from loco_bringup.cli import main as cli
from loco_bringup.cli.clone import root
from loco_control.ros.messages.topics import TOPICS
from loco_sim import effects
from loco_workshop.docs import reference
from loco_workshop.docs.reference import pages


@pytest.mark.pybullet  # the pages name the default engine
@pytest.mark.parametrize("name", pages())
def test_generated_page_is_up_to_date(name):
    assert (root() / "docs" / name).read_text() == pages()[name], "run `./loco docs --write`"


def test_pages_name_everything():
    made = pages()
    for name in TOPICS:
        assert f"`{name}`" in made["topics.md"]
    for name in effects.names():
        page = f"effects_{effects.EFFECTS[name].identity.site}.md"
        assert f"({page}#{name})" in made["effects.md"]
        assert f"## {name}" in made[page]
    assert "`gait.speed`" in made["parameters.md"]
    assert "| `q` | `float64[12]` | rad | joint position |" in made["messages.md"]


def test_the_command_prints_the_pages_or_writes_them(tmp_path, monkeypatch, capsys):
    monkeypatch.setattr(reference, "root", lambda: tmp_path)
    (tmp_path / "docs").mkdir()
    for words in ([], ["--write"]):
        with pytest.raises(SystemExit) as ended:
            cli.main(["docs", *words])
        assert ended.value.code == 0
        out = capsys.readouterr().out
        if words:
            assert {path.name for path in (tmp_path / "docs").iterdir()} == set(pages())
            assert all((tmp_path / "docs" / n).read_text() == text for n, text in pages().items())
        else:
            assert all(text in out for text in pages().values())
            assert not list((tmp_path / "docs").iterdir())
