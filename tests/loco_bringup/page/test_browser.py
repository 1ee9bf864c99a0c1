# SPDX-License-Identifier: Apache-2.0
"""Pages in a browser: nothing that axe calls serious, nothing wider than a phone, plots drawn."""

import functools
import html as escapes
import importlib.util
import io
import json
import re
import shutil
import subprocess
import tempfile
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from PIL import Image

from loco_bringup.bag.reader import Bag
from loco_bringup.calibrate import page as calibration_page
from loco_bringup.gap import check
from loco_bringup.gap import page as gap_page
from loco_bringup.graph import run as runner
from loco_bringup.logs.bag_log import read_log
from loco_bringup.logs.rollout_bag import run_rollout
from loco_bringup.page import html
from loco_bringup.page.plot import Line, Panel, Plot
from loco_bringup.report import compare, robot
from loco_bringup.report import live as live_page
from loco_bringup.report import network as network_page
from loco_bringup.report.live_log import LiveRun
from loco_bringup.reproduce import page as reproduction_page
from loco_bringup.study import page as study_page
from loco_learning.calibration.parameters import parameter_set
from loco_learning.calibration.segments import Segments
from loco_learning.drawing import heat
from loco_learning.drawing.chart import Axis, Chart, Frame
from loco_learning.runs.experiment import load
from loco_learning.runs.rollout import rollout
from loco_learning.study import study as studies
from loco_learning.thesis import registry
from loco_learning.thesis.evidence import Entry
from loco_learning.thesis.registry import Verdict
from loco_sim.plant.model import Model
from loco_workshop.battery import page as battery_page
from loco_workshop.battery import score

from ...loco_learning.calibration.made import made_result
from ...workshop.battery.test_score import rows as score_rows
from ..gap.gap_result import curves, result
from ..gap.test_check import LATE, MAPPING, T, good
from .test_html import BLOCKS

PHONE = 390  # [pixel]
SCREEN = 844  # height [pixel]
MOST = 3_000_000  # [byte]
NAMES = ("chromium", "chromium-browser", "google-chrome")
BROWSER = next(filter(shutil.which, NAMES), None)
AXE = importlib.util.find_spec("axe_core_python")
SCRIPT = """<script>%s</script><script>
new MutationObserver(async (_, seer) => {
  seer.disconnect();
  const bad = ["serious", "critical"];
  const light = (css) => css.match(/[\\d.]+/g).slice(0, 3).map((v) => v / 255)
    .map((v) => (v <= 0.04 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4))
    .reduce((sum, v, k) => sum + v * [0.2126, 0.7152, 0.0722][k], 0.05);
  const contrast = (one, other) => Math.max(one / other, other / one);
  const faint = Array.from(document.querySelectorAll(".swatch")).filter((swatch) => {
    const style = getComputedStyle(swatch), seen = style.backgroundImage.match(/rgba?\\([^)]*\\)/g);
    const behind = light(getComputedStyle(swatch.parentElement).backgroundColor);
    return Math.max(...[...seen, style.outlineColor].map((c) => contrast(light(c), behind))) < 3;
  });
  const serious = (await axe.run(document)).violations.filter((v) => bad.includes(v.impact));
  document.documentElement.style.width = "%dpx";
  for (let k = 0; k < 20 && (!k || document.body.scrollWidth > %d); k++)
    await new Promise((done) => setTimeout(done, 500));  // plots fit themselves in
  const told = document.body.appendChild(document.createElement("pre"));
  told.id = "told";
  told.textContent = JSON.stringify({
    wide: document.body.scrollWidth,
    answer: document.querySelector(".answer")?.getBoundingClientRect().bottom ?? 0,
    marked: document.body.innerText.includes("`"),
    faint: faint.map((swatch) => swatch.parentElement.textContent),
    plots: document.querySelectorAll(".plot canvas, .frame > svg:has(path)").length,
    serious: serious.map((v) => [v.id, v.nodes[0].html.slice(0, 200)]) });
}).observe(document.documentElement, { attributeFilter: ["data-drawn"] });
</script></head>"""

# A hand at the first map: points at its lower left cell, goes right by a key, opens the case,
# switches a colour off and saves.
HAND = """<script>
new MutationObserver(async (_, seer) => {
  seer.disconnect();
  const svg = document.querySelector(".frame > svg"), seen = svg.getBoundingClientRect();
  const read = document.querySelector(".frame .read"), said = {};
  const at = { clientX: seen.left + 60, clientY: seen.bottom - 60, pointerType: "mouse" };
  svg.dispatchEvent(new PointerEvent("pointermove", at));
  said.pointed = read.textContent;
  svg.dispatchEvent(new KeyboardEvent("keydown", { key: "ArrowRight" }));
  said.arrow = read.textContent;
  svg.dispatchEvent(new KeyboardEvent("keydown", { key: "Enter" }));
  await new Promise((done) => setTimeout(done, 300));
  said.case = document.querySelector("#case td").textContent;
  said.shown = svg.querySelectorAll("path").length;
  const buttons = Array.from(document.querySelectorAll("#open-power button"));
  const dashed = buttons.find((b) => b.textContent.startsWith("κ")).firstChild;
  said.swatch = dashed.style.backgroundImage;
  buttons[0].click();
  said.hidden = svg.querySelectorAll("path").length;
  let blob;
  URL.createObjectURL = (saved) => { blob = saved; return "#saved"; };
  buttons.find((b) => b.textContent === "Save CSV").click();
  said.saved = await blob.text();
  const told = document.body.appendChild(document.createElement("pre"));
  told.id = "told"; told.textContent = JSON.stringify(said);
}).observe(document.documentElement, { attributeFilter: ["data-drawn"] });
</script></head>"""

# A hand that shares the page, on a device that shares no files.
SHARE = """<script>
new MutationObserver(async (_, seer) => {
  seer.disconnect();
  const kept = [];
  URL.createObjectURL = (saved) => { kept.push(saved); return "#saved"; };
  document.getElementById("share").click();
  const told = document.body.appendChild(document.createElement("pre"));
  told.id = "told";
  told.textContent = JSON.stringify({ name: kept[0].name, saved: await kept[0].text() });
}).observe(document.documentElement, { attributeFilter: ["data-drawn"] });
</script></head>"""

# An eye that looks which columns of the first plot have something of a colour.
EYE = """<script>
new MutationObserver(async (_, seer) => {
  seer.disconnect();
  const canvas = document.querySelector(".plot canvas"), { width, height } = canvas;
  const seen = canvas.getContext("2d").getImageData(0, 0, width, height).data, columns = new Set();
  for (let i = 0; i < seen.length; i += 4)
    if (seen[i] > 200 && seen[i + 1] < 60 && seen[i + 2] < 60) columns.add((i / 4) % width);
  const told = document.body.appendChild(document.createElement("pre"));
  told.id = "told"; told.textContent = JSON.stringify({ share: columns.size / width });
}).observe(document.documentElement, { attributeFilter: ["data-drawn"] });
</script></head>"""

# A pointer in the middle of the first plot, and out of it again. Pictures are decoded beside the
# virtual time of the browser, whose timers end at once: each pause does real work, too.
POINTER = """<script>
new MutationObserver(async (_, seer) => {
  seer.disconnect();
  const pause = () => {
    for (let i = 0, sum = 0; i < 2e7; i++) sum += i;
    return new Promise((done) => setTimeout(done, 100));
  };
  for (let k = 0; k < 150 && still.width !== 8; k++) {  // a plot drawn anew forgets the pointer
    charts[0].setCursor({ left: charts[0].over.clientWidth / 2, top: 5 });
    await pause();
  }
  const told = document.body.appendChild(document.createElement("pre"));
  const seen = still.getContext("2d").getImageData(4, 4, 1, 1).data, moves = [!movie.hidden];
  charts[0].setCursor({ left: -10, top: -10 });
  await pause();
  moves.push(!movie.hidden);
  told.id = "told";
  told.textContent = JSON.stringify({ moves, seen: Array.from(seen.slice(0, 3)) });
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


def study_of(folder, text, **changes):
    (folder / "mine.yaml").write_text(text)
    made = studies.load(folder / "mine.yaml", **changes)
    study_page.write(made, studies.run(made, folder, 1), folder)
    return (folder / "study.html").read_text()


def grid():
    """The page of a study with maps."""
    with tempfile.TemporaryDirectory() as folder:
        return study_of(Path(folder), GRID)


def trials():
    """The page of a study with figures and seeds."""
    with tempfile.TemporaryDirectory() as folder:
        return study_of(Path(folder), TRIALS, overrides=QUICK)


def battery():
    found = score_rows()
    return battery_page.page(
        "Battery", score.figures(found), found, score.confusion(found), score.figures(found)
    )


def reproduction():
    claim = next(claim for claim in registry.claims() if claim.number == "7.1")
    verdicts = [Verdict(claim, "found", word, "why") for word in registry.VERDICTS]
    chart = heat.cells(np.arange(12.0).reshape(3, 4), "W", name="power")
    axes = (Axis(f"{name} [-]", names=list("abcd")[:n]) for name, n in (("x", 4), ("y", 3)))
    drawn = [reproduction_page.Drawn("a.png", "Figure 7.1", "A map.", Chart([Frame(*axes, chart)]))]
    entries = {"map": Entry("map", "hyq_map", "mujoco")}
    return reproduction_page.page("Claims", "loco x", verdicts, drawn, entries, Path("nowhere"))


def checked():
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder, "moved.csv")
        Path(folder, "mapping.yaml").write_text(MAPPING)
        rows = [f"{t:.4f},{good(t + LATE):.6f},{good(t):.6f}\n" for t in T]
        path.write_text("t,goal,angle\n" + "".join(rows))
        return check.page(check.checked("servo_pendulum", [path], None, 1, lambda *_: None))


def network():
    with tempfile.TemporaryDirectory() as folder:
        experiment = load("msd_20", {"loop.train": 0.8, "loop.closing": 0.2, "loop.test": 0.6})
        assert runner.run(experiment, Path(folder, "bag"), "composed").exit_code == 0
        bag = Bag(Path(folder, "bag"))
        return network_page.page(bag, network_page.read_msd_log(bag), Path(folder, "gait.gif"))


def live():
    """The page of a live calibration, made up, whose messages are those of a rollout."""
    chosen = parameter_set("seven")
    states = [
        SimpleNamespace(
            phase=phase, text="as told", tick=tick, best=best, before=0.4, evaluations=8 * tick,
            names=chosen.names, values=[p.default for p in chosen.parameters],
        )
        for phase, tick, best in (("fitting", 1, 0.3), ("fitting", 2, 0.2), ("done", 3, 0.1))
    ]  # fmt: skip
    wave = np.sin(np.linspace(0.0, 2.0 * np.pi, 50, endpoint=False))
    periods = [
        Segments(1.0, scale * wave[None, :, None] * np.linspace(0.9, 1.1, 3)[:, None, None]
                 * np.ones(2)) for scale in (0.3, 0.2, 0.28)
    ]  # fmt: skip
    with tempfile.TemporaryDirectory() as folder:
        run_rollout(load("tigrillo_bound", {"duration": 0.5}), Path(folder, "bag"), lambda _: None)
        bag = Bag(Path(folder, "bag"))
        sine = load("tigrillo_sine")
        gap = np.column_stack([np.arange(1.0, 7.0), 0.4 / np.arange(1.0, 7.0),
                               [0, 0, 1, 1, 2, 2], [0, 0, 1, 0, 1, 0]])  # fmt: skip
        return live_page.page(LiveRun(
            bag, {"measured": sine, "model": sine}, ("lh_kfe_joint", "rh_kfe_joint"), *periods,
            np.array([2.5, 4.5]), gap, states,
        ))  # fmt: skip


GRID = """
description: two by two
variants: {open: {experiment: hyq_trot_open, learner.stand: 0.2, learner.train: 1.2}}
axes:
  kp: {logspace: [2, 3, 2], sets: [overrides.drives.*_kfe_joint.kp], unit: N·m/rad}
  kd: {logspace: [0, 1, 2], sets: [overrides.drives.*_kfe_joint.kd], unit: N·m·s/rad}
phase: train
metrics: [speed, power]
figures: [survival]
map:
  iso_damping: [0.1]
  legal: {power: [0, 1e6]}
  regions: {soft: {where: {kp: [0, 300]}, what: {survived: [1, 1]}}}
"""
QUICK = {"learner.train": 1.0, "learner.closing": 1.0, "learner.test": 1.0, "gait.start_time": 0.2,
         "learner.stand": 0.2}  # fmt: skip
TRIALS = """
description: two estimators
variants: {pse: {experiment: hyq_short}, rse: {experiment: hyq_short, stance.estimator: rse}}
figures: [nrmse_over_time, limit_cycles, foot_heights, trunk]
metrics: [speed, power]
seeds: [0]
"""
PAGES = {
    "blocks": blocks,
    "gap": lambda: gap_page.page(result(), curves()),
    "gap check": checked,
    "calibration": lambda: calibration_page.page(made_result(), Model("tigrillo")),
    "run": run,
    "comparison": runs,
    "grid": grid,
    "trials": trials,
    "battery": battery,
    "reproduction": reproduction,
    "live": live,
    "network": network,
}
# Those that are made by a graph of nodes.
MARKED = [
    pytest.param(name, marks=[pytest.mark.ros, pytest.mark.xdist_group("graph")])
    if name == "network" else name
    for name in PAGES
]  # fmt: skip


@functools.cache
def written(name):
    """The text of a page, made once for both looks."""
    return PAGES[name]()


@pytest.mark.parametrize("look", ["light", "dark"])
@pytest.mark.parametrize("name", MARKED)
def test_a_page_is_for_everyone(name, look, tmp_path):
    text = written(name).replace('<html lang="en">', f'<html lang="en" data-theme="{look}">')
    axe = Path(AXE.submodule_search_locations[0], "axe.min.js").read_text(encoding="utf-8")
    # Time is virtual there and frames, in which plots fit themselves in, are not: a busy machine
    # may draw none.
    for _ in range(3):
        told = opened(text.replace("</head>", SCRIPT % (axe, PHONE, PHONE)), tmp_path)
        if told["wide"] <= PHONE:
            break
    assert told["serious"] == [] and len(text.encode()) < MOST
    assert told["wide"] <= PHONE and told["faint"] == [] and not told["marked"]
    if name == "gap":
        assert 0 < told["answer"] <= SCREEN
    assert told["plots"] == sum(len(json.loads(data)["panels"]) for data in plotted(text)) > 0


def test_a_cell_says_its_value_opens_its_case_and_is_saved(tmp_path):
    told = opened(written("grid").replace("</head>", HAND), tmp_path)
    assert re.fullmatch(r"power [\d.]+ W · kp 100 · kd 1", told["pointed"])
    assert told["arrow"].endswith("kp 1000 · kd 1") and told["case"] == "open_01_00_0"
    assert told["hidden"] < told["shown"]
    assert all(f"rgb({c}, {c}, {c})" in told["swatch"] for c in (0, 255))  # black on a white edge
    head, *rows = told["saved"].splitlines()
    assert head == '"frame","name","x","y","x end","y end","text"'
    assert [row for row in rows if '"100","1"' in row and " W" in row]


def test_a_signal_slower_than_the_axis_is_a_line_that_only_a_pause_interrupts(tmp_path):
    t, slow = np.arange(2000) / 2000.0, np.full(2000, np.nan)
    slow[3::20] = 1.0
    halved = np.where((t < 0.01) | (t > 0.5), slow, np.nan)
    whole = seen_share(t, np.ones(2000), tmp_path)
    assert whole > 0.5 and seen_share(t, slow, tmp_path) == pytest.approx(whole, rel=0.02)
    assert seen_share(t, halved, tmp_path) == pytest.approx(0.5 * whole, rel=0.04)


def seen_share(t, values, folder):
    """Share of the width of a plot in which a line is drawn."""
    plot = Plot(t, [Panel("q [rad]", [Line("q", values, "#ff0000", 3.0)])])
    shown = [html.part("A log", lambda: html.figure(plot, "A log", ""))]
    text = html.document("Slow", html.paragraph("A page for a test."), shown)
    text = text.replace('<html lang="en">', '<html lang="en" data-theme="light">')
    return opened(text.replace("</head>", EYE), folder)["share"]


def test_the_animation_stands_at_the_time_under_the_pointer(tmp_path):
    colors = [(0, 0, 0), (255, 0, 0), (0, 0, 255), (0, 255, 0), (255, 255, 255)]
    first, *others = (Image.new("RGB", (8, 8), color) for color in colors)
    gif = io.BytesIO()
    first.save(gif, "GIF", save_all=True, append_images=others, duration=100)
    plot = Plot(
        np.linspace(1.0, 3.0, 201), [Panel("q [rad]", [Line("q", np.ones(201), "#000000")])]
    )
    shown = [
        html.part("A log", lambda: html.figure(plot, "A log", "")),
        html.part("Animation", lambda: html.movie(gif.getvalue(), "It moves.", 1.0, 3.0)),
    ]
    text = html.document("Moving", html.paragraph("A page for a test."), shown)
    told = opened(text.replace("</head>", POINTER), tmp_path)
    assert told == {"moves": [False, True], "seen": list(colors[2])}


def test_what_is_shared_is_the_page_before_anything_was_drawn(tmp_path):
    text = written("gap").replace("</head>", SHARE)
    told = opened(text, tmp_path)
    assert told["name"] == "gap_of_servo_pendulum.html"
    assert plotted(told["saved"]) == plotted(text) and "<canvas" not in told["saved"]
    assert opened(told["saved"], tmp_path) == told


def opened(text, folder):
    """What a page says of itself in a browser, in an element `told`."""
    page = folder / "page.html"
    page.write_text(text, encoding="utf-8")
    options = [
        "--headless", "--no-sandbox", "--disable-gpu", "--no-first-run", "--disable-sync",
        "--disable-background-networking", "--disable-component-update",
        f"--user-data-dir={folder}/profile", "--virtual-time-budget=20000",
        "--window-size=500,900", "--dump-dom",
    ]  # fmt: skip
    command = [BROWSER, *options, page.as_uri()]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120)
    return json.loads(escapes.unescape(re.search(r'<pre id="told">(.*?)</pre>', done.stdout)[1]))


def plotted(text):
    return re.findall(r'<script type="application/json">(.*?)</script>', text)
