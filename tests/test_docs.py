# SPDX-License-Identifier: Apache-2.0
"""Pages have working links and at most 250 lines, and the index of docs/ names every page."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
PAGES = [*sorted(ROOT.glob("*.md")), *sorted((ROOT / "docs").glob("*.md"))]
MAX_LINES = 250  # of a page


def links(text: str) -> list[str]:
    """Targets of the links of a page that are not addresses."""
    text = re.sub(r"```.*?```", "", text, flags=re.DOTALL)
    return [t for t in re.findall(r"\]\(([^)\s]+)\)", text) if "://" not in t]


def anchors(text: str) -> set[str]:
    """Names by which a page's headings are linked, as GitHub makes them."""
    text = re.sub(r"```.*?```", "", text, flags=re.DOTALL)
    titles = re.findall(r"^#+ (.+)$", text, re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", title.lower()).replace(" ", "-") for title in titles}


def test_links_and_anchors_are_found():
    assert links("[a](b.md#c) ![d](e.png) `[f]` [g](https://h.i)") == ["b.md#c", "e.png"]
    assert anchors("# One `two`, three\n```\n# no\n```") == {"one-two-three"}


@pytest.mark.parametrize("page", PAGES, ids=lambda p: p.relative_to(ROOT).as_posix())
def test_links_lead_somewhere(page):
    lost = []
    for target in links(page.read_text()):
        path, _, anchor = target.partition("#")
        file = (page.parent / path).resolve() if path else page
        if not file.exists() or (anchor and anchor not in anchors(file.read_text())):
            lost.append(target)
    assert lost == []


def test_the_index_names_every_page():
    index = {target.partition("#")[0] for target in links((ROOT / "docs/index.md").read_text())}
    index = {target for target in index if target.endswith(".md")}
    assert index == {page.name for page in (ROOT / "docs").glob("*.md")} - {"index.md"}


def test_no_page_is_long():
    lines = {p.name: p.read_text().count("\n") for p in (ROOT / "docs").glob("*.md")}
    assert len(lines) > 30
    assert {name: n for name, n in lines.items() if n > MAX_LINES} == {}
