# SPDX-License-Identifier: Apache-2.0
"""The report of real runs: whole, self-contained, repeatable, and honest about what is missing."""

import base64
import dataclasses
import re
from html.parser import HTMLParser
from io import BytesIO

import numpy as np
import pytest
from PIL import Image

from loco_bringup.bag.reader import Bag
from loco_bringup.bag.writer import BagWriter
from loco_bringup.logs.bag_log import read_log
from loco_bringup.logs.rollout_bag import run_rollout
from loco_bringup.report import parts, report, robot
from loco_bringup.report.figures import CHAPTERS
from loco_bringup.report.report import write_report
from loco_bringup.report.robot import page
from loco_control.exceptions import BagError, MissingFileError, ParameterError
from loco_learning.metrics.registry import METRICS
from loco_learning.runs.experiment import override

DELAY = {"name": "command_delay", "delay": 0.008, "start": 2.0}
SECTIONS = (
    "Facts",
    "Who drives hips and knees",
    "Metrics",
    "Effects",
    "Configuration",
    "Messages",
)


class Page(HTMLParser):
    """Headings, images, links and text of a page; fails where tags do not match."""

    VOID = ("meta", "img", "br", "link")

    def __init__(self, text):
        super().__init__()
        self.stack, self.texts, self.images, self.addresses = [], {}, [], []
        self.feed(text)
        assert not self.stack

    def handle_starttag(self, tag, attrs):
        attrs = dict(attrs)
        self.addresses += [attrs[k] for k in ("src", "href") if k in attrs]
        if tag == "img":
            assert attrs["alt"]
            self.images.append(attrs["src"])
        if tag not in self.VOID:
            self.stack.append(tag)

    def handle_endtag(self, tag):
        assert self.stack.pop() == tag

    def handle_data(self, data):
        if self.stack:
            self.texts.setdefault(self.stack[-1], []).append(data)

    def text(self, tag):
        return " ".join(self.texts.get(tag, []))


def run(experiment, folder):
    run_rollout(experiment, folder, lambda progress: None)
    return Bag(folder)


@pytest.fixture(scope="module")
def bag(short, tmp_path_factory):
    """A run through all phases, with an effect, and a description that is hard to print."""
    changes = {
        "learner.test": 1.2,
        "effects": [DELAY],
        "description": "costs $5 & is <b>not</b> bold",
    }
    return run(override(short, changes), tmp_path_factory.mktemp("report") / "learned")


@pytest.fixture(scope="module")
def log(bag):
    return read_log(bag)


@pytest.fixture(scope="module")
def text(bag):
    with pytest.MonkeyPatch.context() as patch:  # an animation as large as a stamp is faster
        patch.setattr(parts, "SIZE", (96, 64))
        patch.setattr(parts, "FPS", 8.0)
        return report.write_report(bag.folder).read_text()


@pytest.fixture(scope="module")
def parsed(text):
    return Page(text)


def shown(page, text):
    """Number of pictures and of plots."""
    return len(page.images) + text.count('<figure class="plot"')


def first_screen(text):
    return text.partition("<nav")[0]


def section(text, title):
    return re.search(rf"<h2>{title}</h2>(.*?)</section>", text, re.S)[1]


def test_every_part_is_there_and_none_is_missing(text, parsed):
    assert parsed.texts["h1"] == ["hyq_short"]
    assert set(parsed.texts["h2"]) == {c.title for c in CHAPTERS} | set(SECTIONS)
    assert "Not shown" not in text
    assert shown(parsed, text) == len(CHAPTERS) + 2  # animation and readout check


def test_no_part_of_the_page_is_elsewhere(text, parsed):
    assert "http" not in text
    assert all(address.startswith(("data:image/", "#")) for address in parsed.addresses)
    anchors = {address[1:] for address in parsed.addresses if address.startswith("#")}
    assert all(f'id="{anchor}"' in text for anchor in anchors)
    assert len(text) < 3e6


def test_the_only_picture_is_the_animation(parsed):
    assert [i.partition(";")[0] for i in parsed.images] == ["data:image/gif"]


def test_the_animation_is_in_the_page_and_beside_it(bag, parsed):
    beside = (bag.folder / "gait.gif").read_bytes()
    inside = next(i for i in parsed.images if i.startswith("data:image/gif"))
    assert base64.b64decode(inside.split(",")[1]) == beside
    movie = Image.open(BytesIO(beside))
    assert movie.n_frames > 20
    first = movie.convert("RGB").tobytes()
    movie.seek(movie.n_frames // 2)
    assert movie.convert("RGB").tobytes() != first  # it moves


def test_every_metric_has_a_row_with_unit_equation_and_value_of_each_phase(text, log):
    rows = re.findall(r"<tr>(.*?)</tr>", section(text, "Metrics"))
    assert (
        "".join(re.findall(r"<th.*?>(.*?)</th>", rows[0])) == "MetrictrainclosingtestUnitEquation"
    )
    # A bag has no wall-clock times, and HyQ no passive joint.
    said = [m for m in METRICS.values() if m.name not in ("step_time", "passive_range")]
    assert len(rows) == 1 + len(said)
    for row, metric in zip(rows[1:], said, strict=True):
        cells = re.findall(r"<td.*?>(.*?)</td>", row)
        assert cells[-1] == metric.equation
        assert cells[-2] == metric.unit
    speed = next(row for row in rows if row.startswith("<td>Speed<"))
    assert f"{METRICS['speed'](log, log.phase_of('test')):.4g}" in speed


def test_the_readout_is_verified_from_the_bag(text):
    assert '<span class="good">Verified:</span> the readout drives HFE and KFE' in text


def test_the_effect_is_told_with_unit_and_window(text):
    told = section(text, "Effects")
    assert "command_delay" in told
    assert "delay = 0.008 s" in told
    assert "2 s to the end" in told


def test_every_topic_is_counted(bag, text):
    told = section(text, "Messages")
    for topic in bag.topics.values():
        assert re.search(rf"<code>{topic.name}</code>.*?>{topic.count}<", told)
    assert ">250<" in told  # rate of robot_state


def test_words_of_the_experiment_are_text_not_markup(parsed):
    assert "costs $5 & is <b>not</b> bold" in parsed.text("p")


def test_the_same_bag_gives_the_same_page_with_or_without_animation(bag, text, tmp_path):
    again = write_report(bag.path, tmp_path / "deep" / "b.html", gif=False).read_text()
    assert not (tmp_path / "deep" / "gait.gif").exists()
    assert "the animation was left out" in first_screen(again)
    assert again.replace(first_screen(again), first_screen(text)) == text


def test_an_open_loop_run_has_a_report(short, tmp_path):
    open_loop = {"learner.enabled": False, "learner.closing": 0.0, "learner.test": 0.0}
    bag = run(override(short, open_loop), tmp_path / "open")
    text = page(bag, read_log(bag), None)
    assert "open loop" in section(text, "Metrics")
    assert "this run has no network" in section(text, "Prediction error")
    assert "carries no weights.npz" in section(text, "Who drives hips and knees")
    assert section(text, "Effects").strip().startswith('<p class="missing">')
    assert "<figure" in section(text, "Foot cycles")


@pytest.mark.parametrize("ticks", [1, 2, 251, 600])
def test_a_run_that_broke_off_has_a_report(bag, log, ticks):
    text = page(bag, log.cut(slice(0, ticks)), None)
    Page(text)
    assert f"the recording ends at {ticks * log.dt:.1f} of" in text
    assert "has no test phase" in section(text, "Who drives hips and knees")
    assert "<figure" in section(text, "Timeline")


def test_a_fall_is_on_top_of_the_page_and_in_the_timeline(bag, log):
    fallen = dataclasses.replace(log, fall="roll is 0.9 rad, beyond 0.8 rad")
    text = robot.header(bag, fallen, {}, BagError("no network"), "")
    assert f'<p class="verdict bad">fell at {len(log) * log.dt:.1f} s: roll is 0.9 rad' in text
    assert "failed: fall" in robot.facts(bag, fallen, BagError("no network"))
    timeline = next(c for c in CHAPTERS if c.title == "Timeline")
    assert "fall" in {layer.name for layer in timeline.draw(fallen).frames[0].layers}
    assert "fall" not in {layer.name for layer in timeline.draw(log).frames[0].layers}


def test_a_bag_without_ground_truth_says_so(bag, log):
    names = ("position", "orientation", "velocity", "spin")
    blind = log.changed(**{name: np.full_like(log.columns[name], np.nan) for name in names})
    text = page(bag, blind, bag.folder / "unused.gif")
    assert "the bag has no ground_truth/odom" in first_screen(text)
    for title in ("Trunk motion", "Power, speed and cost of transport"):
        assert "the bag has no ground_truth/odom" in section(text, title)
    assert "<figure" in section(text, "Joint tracking")


def test_wrong_input_is_one_clear_line(bag, tmp_path):
    with pytest.raises(MissingFileError, match="no bag at"):
        write_report(tmp_path / "nowhere")
    writer = BagWriter(tmp_path / "other")
    writer.close()
    with pytest.raises(ParameterError, match="it has nothing"):
        write_report(tmp_path / "other")
    (tmp_path / "file").write_text("")
    with pytest.raises(MissingFileError, match="cannot write the report"):
        write_report(bag, tmp_path / "file" / "report.html", gif=False)
