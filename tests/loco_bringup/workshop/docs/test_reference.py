# SPDX-License-Identifier: Apache-2.0
"""The tables in ``docs/`` are those of the code."""

import pytest

from loco_bringup.workshop.docs.reference import pages, root
from loco_control.ros.messages.topics import TOPICS
from loco_sim import effects


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
