# SPDX-License-Identifier: Apache-2.0
"""The documentation site is built whole, and needs nothing from elsewhere."""

import re
import shutil
import subprocess
from pathlib import Path

import pytest

from loco_bringup.cli.clone import root
from loco_control.exceptions import LocoError
from loco_workshop.docs.flowchart import svg
from loco_workshop.docs.site import build
from loco_workshop.docs.site_hooks import API, notebook, on_page_markdown


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    folder = tmp_path_factory.mktemp("site")
    build(root(), folder)
    return folder


def test_every_page_is_there_and_none_is_long(site):
    pages = {path.stem for path in (root() / "docs").glob("*.md")}
    made = {path.stem for path in site.glob("*.html")}
    assert pages | {Path(name).stem for name in API} | {"csv_to_gap"} <= made
    assert pages <= set(re.findall(r"(\w+)\.md", (root() / "mkdocs.yml").read_text()))
    lengths = {p.name: len(p.read_text().splitlines()) for p in (root() / "docs").glob("*.md")}
    assert {name: n for name, n in lengths.items() if n > 300} == {}


def test_pages_load_nothing_from_elsewhere(site):
    for path in site.glob("*.html"):
        assert not re.search(r'<(?:script|link|img)[^>]+(?:src|href)="https?:', path.read_text())


def test_the_reference_has_units_and_errors(site):
    text = "".join((site / name).with_suffix(".html").read_text() for name in API)
    for name in ("loco.find_gap", "loco_sim.robot.robot.load", "loco_bringup.bag.reader.Bag"):
        assert f'id="{name}"' in text
    assert "Raises" in text


@pytest.mark.skipif(not shutil.which("chromium"), reason="needs Chromium")
def test_search_works_from_a_file(site):
    command = ["chromium", "--headless", "--no-sandbox", "--virtual-time-budget=60000"]
    address = f"{(site / 'index.html').as_uri()}?q=backlash"
    done = subprocess.run([*command, "--dump-dom", address], capture_output=True, check=True)
    assert re.search(r"[0-9]+ matching documents", done.stdout.decode())


def test_flowcharts_are_drawn(site):
    for name in ("design", "running", "live_calibration"):
        text = (site / f"{name}.html").read_text()
        assert "flowchart LR" not in text and "<svg viewBox" in text
    picture = svg('flowchart LR\n  a[plant: model] -- state --> b\n  b -- "command, t" --> a')
    words = re.findall(r">([^<]+)</text>", picture)
    assert words == ["state", "command, t", "plant", "model", "b"]
    assert picture.count("marker-end") == 2
    left = [float(x) for x in re.findall(r'<rect x="([0-9]+)"', picture)]
    assert left[0] < left[1]  # the command leads back


def test_a_notebook_is_a_page_with_its_outputs():
    code = {"cell_type": "code", "source": ["1 + 1"], "outputs": [
        {"data": {"text/plain": ["2"]}}, {"text": ["done\n"]}, {"data": {"image/png": "ab\n"}},
        {"data": {"text/plain": ["Gap(folder)"], "text/html": ["<pre>Named</pre>"]}},
    ]}  # fmt: skip
    text = notebook({"cells": [{"cell_type": "markdown", "source": ["# A"]}, code]})
    assert text.startswith("# A\n\n```python\n1 + 1\n```\n\n```text\n2\n```\n\n```text\ndone")
    assert text.endswith("![output](data:image/png;base64,ab)\n\n<pre>Named</pre>\n")
    assert on_page_markdown("[n](csv_to_gap.ipynb)") == "[n](csv_to_gap.md)"


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
