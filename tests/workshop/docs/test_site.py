# SPDX-License-Identifier: Apache-2.0
"""The documentation site is built whole, and needs nothing from elsewhere."""

import re

import pytest

from loco_bringup.cli.clone import root
from loco_control.exceptions import LocoError
from loco_workshop.docs.site import build
from loco_workshop.docs.site_hooks import on_page_markdown


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    folder = tmp_path_factory.mktemp("site")
    build(root(), folder)
    return folder


def test_every_page_is_there_and_none_is_long(site):
    pages = {path.stem for path in (root() / "docs").glob("*.md")}
    assert pages - {"index"} | {"api"} <= {path.parent.name for path in site.glob("*/index.html")}
    assert pages <= set(re.findall(r"(\w+)\.md", (root() / "mkdocs.yml").read_text()))
    lengths = {p.name: len(p.read_text().splitlines()) for p in (root() / "docs").glob("*.md")}
    assert {name: n for name, n in lengths.items() if n > 300} == {}


def test_pages_load_nothing_from_elsewhere(site):
    for path in site.glob("*/index.html"):
        assert not re.search(r'<(?:script|link|img)[^>]+(?:src|href)="https?:', path.read_text())


def test_the_reference_has_units_and_errors(site):
    text = (site / "api/index.html").read_text()
    for name in ("loco.find_gap", "loco_sim.robot.robot.load", "loco_bringup.bag.reader.Bag"):
        assert f'id="{name}"' in text
    assert "Raises" in text


def test_files_beside_the_pages_are_named():
    assert (
        on_page_markdown("see [how](../CONTRIBUTING.md#words).") == "see how (`CONTRIBUTING.md`)."
    )
    assert on_page_markdown("[b](c.md#d)") == "[b](c.md#d)"


def test_a_link_that_leads_nowhere_is_an_error(tmp_path):
    (tmp_path / "docs").mkdir()
    (tmp_path / "docs" / "index.md").write_text("[a](b.md)\n")
    (tmp_path / "mkdocs.yml").write_text("site_name: x\n")
    with pytest.raises(LocoError, match="b.md"):
        build(tmp_path, tmp_path / "site")
