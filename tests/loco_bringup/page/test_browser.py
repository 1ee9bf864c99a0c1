# SPDX-License-Identifier: Apache-2.0
"""Pages in a browser: nothing that axe calls serious, nothing wider than a phone, plots drawn."""

import html as escapes
import importlib.util
import json
import re
import shutil
import subprocess
import tempfile
from pathlib import Path

import pytest

from loco_bringup.bag.reader import Bag
from loco_bringup.calibrate import page as calibration_page
from loco_bringup.gap import page as gap_page
from loco_bringup.logs.bag_log import read_log
from loco_bringup.logs.rollout_bag import run_rollout
from loco_bringup.page import html
from loco_bringup.report import compare, robot
from loco_learning.runs.experiment import load
from loco_learning.runs.rollout import rollout
from loco_sim.plant.model import Model

from ...loco_learning.calibration.made import made_result
from ..gap.gap_result import curves, result
from .test_html import BLOCKS

PHONE = 390  # [pixel]
NAMES = ("chromium", "chromium-browser", "google-chrome")
BROWSER = next(filter(shutil.which, NAMES), None)
AXE = importlib.util.find_spec("axe_core_python")
SCRIPT = """<script>%s</script><script>
new MutationObserver(async (_, seer) => {
  seer.disconnect();
  const bad = ["serious", "critical"];
  const serious = (await axe.run(document)).violations.filter((v) => bad.includes(v.impact));
  document.documentElement.style.width = "%dpx";
  for (let k = 0; k < 20 && (!k || document.body.scrollWidth > %d); k++)
    await new Promise((done) => setTimeout(done, 500));  // plots fit themselves in
  const told = document.body.appendChild(document.createElement("pre"));
  told.id = "told";
  told.textContent = JSON.stringify({
    wide: document.body.scrollWidth, plots: document.querySelectorAll(".plot canvas").length,
    serious: serious.map((v) => [v.id, v.nodes[0].html.slice(0, 200)]) });
}).observe(document.documentElement, { attributeFilter: ["data-drawn"] });
</script></head>"""

pytestmark = [
    pytest.mark.skipif(BROWSER is None, reason="no chromium is installed"),
    pytest.mark.skipif(AXE is None, reason="axe-core-python is not installed"),
]


def blocks():
    """A page with every block of the toolkit."""
    shown = [html.part(name, lambda make=make: make("a text")) for name, make in BLOCKS.items()]
    return html.document("Every block", html.paragraph("A page for a test."), shown)


def run():
    with tempfile.TemporaryDirectory() as folder:
        run_rollout(load("tigrillo_bound", {"duration": 2.0}), Path(folder, "bag"), lambda _: None)
        bag = Bag(Path(folder, "bag"))
        return robot.page(bag, read_log(bag), None)


def runs():
    log = rollout(load("servo_pendulum_sine", {"duration": 12.0}))
    return compare.page({"one": log, "other": log})


PAGES = {
    "blocks": blocks,
    "gap": lambda: gap_page.page(result(), curves()),
    "calibration": lambda: calibration_page.page(made_result(), Model("tigrillo")),
    "run": run,
    "comparison": runs,
}


@pytest.mark.parametrize("look", ["light", "dark"])
@pytest.mark.parametrize("name", PAGES)
def test_a_page_is_for_everyone(name, look, tmp_path):
    text = PAGES[name]().replace('<html lang="en">', f'<html lang="en" data-theme="{look}">')
    axe = Path(AXE.submodule_search_locations[0], "axe.min.js").read_text(encoding="utf-8")
    page = tmp_path / "page.html"
    page.write_text(text.replace("</head>", SCRIPT % (axe, PHONE, PHONE)), encoding="utf-8")
    options = ["--headless", "--no-sandbox", "--disable-gpu", f"--user-data-dir={tmp_path}/profile"]
    options += ["--virtual-time-budget=20000", "--window-size=500,900", "--dump-dom"]
    command = [BROWSER, *options, page.as_uri()]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120)
    told = json.loads(escapes.unescape(re.search(r'<pre id="told">(.*?)</pre>', done.stdout)[1]))
    assert told["serious"] == []
    assert told["wide"] <= PHONE
    assert told["plots"] == sum(len(json.loads(data)["panels"]) for data in plotted(text)) > 0


def plotted(text):
    return re.findall(r'<script type="application/json">(.*?)</script>', text)
