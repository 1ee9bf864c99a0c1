# SPDX-License-Identifier: Apache-2.0
"""`loco gap`: its words, its page, its files, and one line for every mistake."""

from __future__ import annotations

import html
import json
import re
from html.parser import HTMLParser

import numpy as np
import pytest

from loco_bringup.cli import main as cli
from loco_bringup.cli.table import parser
from loco_bringup.gap import next as following
from loco_bringup.gap import page as pages
from loco_bringup.gap import run as runner
from loco_bringup.gap import terminal, text
from loco_control.exceptions import LocoError, ParameterError
from loco_learning.gap import workflow
from loco_learning.gap.proposals import pool
from loco_learning.runs.experiment import load as load_experiment
from loco_sim.plant import model as models
from loco_sim.plant.model import Model

from .gap_result import NEXT, curves, result

VERDICTS = ("named", "ambiguous", "unknown", "no gap")


@pytest.fixture(scope="module")
def records():
    model = Model("servo_pendulum")
    chosen = [pool.choose(pool.pool(model), name) for name in ("chirp_large", "steps")]
    return pool.records(model, chosen)


@pytest.fixture
def found(monkeypatch, records):
    """The workflow answers at once; recordings are those of a model."""
    asked = {}

    def find(model, fit, held, params, progress, workers, keep, memory):
        asked.update(model=model, fit=fit, held=held, params=params, workers=workers)
        progress(0.5, "screening", "coulomb_friction")
        known = result(
            settings={"seed": np.int64(params.seed), "window": 0.0, "worst": float("nan")}
        )
        keep({**known, "next": []}, curves())
        progress(0.95, "looking for the next experiment", "coulomb_friction")
        return known

    monkeypatch.setattr(workflow, "find", find)
    monkeypatch.setattr(
        runner,
        "load",
        lambda path, robot, mapping=None, judge=True: [records["steps" in str(path)]],
    )
    return asked


def call(*arguments):
    """Exit code of a command line."""
    with pytest.raises(SystemExit) as end:
        cli.main(["gap", *map(str, arguments)])
    return end.value.code


@pytest.mark.parametrize("verdict", VERDICTS)
def test_every_verdict_is_one_sentence_without_names_of_code(verdict):
    line = text.headline(result(verdict))
    assert line.lower().startswith(verdict)
    assert "_" not in line and "None" not in line


@pytest.mark.parametrize("adequate", [True, False])
def test_what_an_ambiguous_model_leaves_is_in_its_headline(adequate):
    """A name beside it would otherwise read as if nothing else was missing."""
    line = text.headline({**result("ambiguous"), "adequate": adequate})
    assert line.endswith("More is missing.") is not adequate


def test_words_say_what_where_and_how_big():
    (line,) = text.term_lines(result())
    assert line.startswith("coulomb friction in pivot: torque 0.0512 N·m (0.047 to 0.056)")
    assert line.endswith("; probability 0.96")
    told = {**result(), "terms": [{**result()["terms"][0], "amount": "the limit is 1.4 N·m"}]}
    (line,) = text.term_lines(told)
    assert line.endswith(", so that the limit is 1.4 N·m; probability 0.96")
    assert "14.2 noise floors before, 1.32 after; share closed 94 %" in text.gap_line(result())
    assert "(of the rms above the noise floor)" in text.gap_line(result())
    line = text.gap_line(result("unknown"))  # nothing is added to the model
    assert line.endswith("14.2 noise floors before") and "94" not in line
    assert text.place_of("*_kfe_joint") == "all kfe"
    assert text.place_of(None) == "the whole robot"
    assert text.next_line(NEXT).startswith("slow ramp tells coulomb friction from stribeck")


class Reader(HTMLParser):
    """Counts tags and collects words."""

    def __init__(self, page):
        super().__init__()
        self.open, self.words = [], []
        self.feed(page)

    def handle_starttag(self, tag, attrs):
        if tag not in ("meta", "img", "br", "link"):
            self.open.append(tag)
        for _, value in attrs:
            assert not str(value).startswith(("http:", "https:", "//"))

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        self.words.append(data)


def test_what_the_recordings_cannot_tell_a_test_at_the_robot_can():
    delay = result("ambiguous", ambiguous=[["command_delay", "sensor_latency"]], next=[])
    (line,) = text.at_the_robot(delay)
    assert line.startswith("command delay from sensor latency: ")
    assert "push the robot by hand" in line
    assert line in " ".join(Reader(pages.page(delay, curves())).words)
    assert text.at_the_robot(result("named")) == []
    nominal = result("ambiguous", ambiguous=[["coulomb_friction", "drives.pivot.gain"]])
    assert text.at_the_robot(nominal) == []


@pytest.mark.parametrize("verdict", VERDICTS)
def test_the_page_is_whole_and_names_no_address(verdict):
    page = pages.page(result(verdict), curves())
    reader = Reader(page)
    assert reader.open == []
    words = " ".join(reader.words)
    assert text.headline(result(verdict)) in words
    assert words.index("14.2") < words.index("Before and after", words.index("Settings"))
    assert "Not shown" not in words
    assert page == pages.page(result(verdict), curves())


def test_doubts_about_reading_stand_before_the_name_and_on_the_first_screen(capsys, tmp_path):
    """A recorder that stopped, or a late clock, can be all that there is of a gap."""
    note = "steps: angles and commands pause for 0.6 s at row 150 of q of pivot: cut there"
    shown = result(reading=[note])
    terminal.show(shown, tmp_path)
    said = " ".join(capsys.readouterr().out.split())
    assert said.startswith(f"reading: {note} Named:")
    words = " ".join(Reader(pages.page(shown, curves())).words)
    assert words.index(f"Reading: {note}") < words.index("Before and after")
    terminal.show(result(), tmp_path)
    assert capsys.readouterr().out.startswith("Named:")


def top(**changes):
    """What stands above the contents of a page."""
    return pages.page(result(**changes), curves()).partition("<nav")[0]


def test_the_size_is_the_largest_number_and_stands_first():
    shown = top()
    assert "<b>0.0512 N·m</b>" in shown and "coulomb friction in pivot, torque" in shown
    assert shown.index("<b>0.0512") < shown.index('<figure class="plot"') < shown.index("14.2 →")
    two = [result()["terms"][0], dict(result()["terms"][0], place="knee")]
    assert top(terms=two).count("<b>0.0512 N·m</b>") == 2


@pytest.mark.parametrize(
    ("changes", "step"),
    [
        ({}, "record slow ramp tells coulomb friction from stribeck friction apart"),
        ({"next": []}, "loco gap DIR --add BAG"),
        ({"next": [], "regions": [], "where": []}, "loco gap DIR --add BAG"),
    ],
)
def test_an_unknown_page_leads_with_where_the_gap_lives_and_the_next_step(changes, step):
    shown = top(verdict="unknown", **changes)
    places = changes.get("regions", result()["regions"]) or ["all of the data"]
    where = html.escape(places[0])
    assert shown.index("The gap lives in") < shown.index(where) < shown.index("Next step")
    assert step in shown and "model after" not in shown and "Share closed" not in shown


@pytest.mark.parametrize("verdict", VERDICTS)
def test_one_thing_has_one_word_that_is_defined_where_it_first_stands(verdict):
    page = re.sub("<figure.*?</figure>", "", pages.page(result(verdict), curves()), flags=re.S)
    page = page.partition("<body>")[2]
    first, line = page.index("noise floor"), text.gap_line(result(verdict))
    assert page[first:].startswith(f"noise floors, on held-out data. {text.FLOOR}")
    assert "times the noise" not in page + line and "noise floors" in line


def test_a_page_of_little_is_drawn_too():
    bare = result("unknown", where=[], regions=[], rivals=[], next=[], align=[], identifiability={})
    assert "Not shown" not in pages.page(bare, curves())


def test_a_setting_that_overthrows_a_name_is_on_the_page():
    row = {"vary": "split", "setting": "steps judges", "names": [], "probability": 0.02,
           "closed": -0.4}  # fmt: skip
    words = " ".join(Reader(pages.page(result(over_settings=[row]), curves())).words)
    assert "steps judges nothing 0.02 -40 %" in words
    assert "hang on a setting" not in " ".join(Reader(pages.page(result(), curves())).words)


def test_alarms_and_corrections_are_seen():
    shown = pages.page(
        result(
            "unknown",
            alarms=["damping is negative"],
            correction={"kind": "correction, not explanation"},
        ),
        curves(),
    )
    assert "Alarm: damping is negative" in shown
    assert "Correction, not explanation" in shown


LEARNED = {
    "kind": "correction: not an explanation", "used": True, "before": 14.2, "after": 2.84,
    "closed": 0.8, "joints": ["pivot"], "says": "It closes 80 % and explains nothing.",
    "effects": [{"name": "learned_residual", "joint": "pivot", "weights": [0.01] * 18}],
}  # fmt: skip


def test_a_learned_correction_is_marked_wherever_it_is():
    gap = result("unknown", residual=LEARNED)
    words = " ".join(Reader(pages.page(gap, curves())).words)
    assert "correction, not an explanation: It closes 80 % and explains nothing." in words
    assert "Learned correction" in words and "80 %" in words and "learned_residual" in words
    assert text.headline(gap) == text.headline(result("unknown"))
    assert [e["name"] for e in runner.patched(gap).effects] == ["learned_residual"]
    refused = {**LEARNED, "used": False, "effects": [], "says": "Left out: chance."}
    words = " ".join(Reader(pages.page(result("unknown", residual=refused), curves())).words)
    assert "Left out: chance." in words and "Learned correction" not in words
    assert runner.patched(result("unknown", residual=None)).effects == []


def test_the_option_asks_for_a_learned_correction(found, tmp_path):
    asked = "chirp", "--hold-out", "steps", "--robot", "servo_pendulum", "--workers", "1"
    assert call(*asked, "--out", tmp_path / "plain") == 0
    assert found["params"].residual is False
    assert call(*asked, "--residual", "--out", tmp_path / "asked") == 0
    assert found["params"].residual is True
    assert runner.load_job(tmp_path / "asked").options["residual"] is True


def test_a_search_writes_every_file_and_the_same_bytes_again(found, tmp_path):
    told = []
    for name in ("one", "two"):
        job = runner.Job("servo_pendulum", ("chirp", "steps"))
        runner.run(job, tmp_path / name, lambda *news: told.append(news))
    assert len(found["fit"]) == len(found["held"]) == 1  # the last one is held out
    assert (0.5, "screening", "coulomb_friction") in told
    names = {p.name for p in (tmp_path / "one").iterdir()}
    assert names == {"gap.json", "gap.html", "gap.npz", "job.json", "model.yaml"}
    for name in names:
        assert (tmp_path / "one" / name).read_bytes() == (tmp_path / "two" / name).read_bytes()
    values = json.loads((tmp_path / "one/gap.json").read_text())
    assert list(values) == sorted(values)
    assert values["settings"]["worst"] is None  # JSON has no NaN
    assert models.load(tmp_path / "one/model.yaml").effects[0]["name"] == "coulomb_friction"


@pytest.mark.parametrize("broken", ["the next experiment", "page"])
def test_what_comes_after_the_verdict_cannot_cost_it(found, tmp_path, monkeypatch, broken):
    """Files of the verdict are there whatever breaks later, and a new search may overwrite them."""

    def tell(share, stage, best):
        if broken in stage:
            raise RuntimeError(stage)

    out = tmp_path / "out"
    with pytest.raises(RuntimeError, match=broken):
        runner.run(runner.Job("servo_pendulum", ("chirp", "steps")), out, tell)
    assert json.loads((out / "gap.json").read_text())["verdict"] == "named"
    assert models.load(out / "model.yaml").effects[0]["name"] == "coulomb_friction"
    assert runner.load_job(out).bags == ("chirp", "steps")
    runner.claim(out, runner.JOB)


def test_the_command_says_verdict_and_files(found, tmp_path, capsys):
    out = tmp_path / "out"
    code = call("chirp", "--hold-out", "steps", "--robot", "servo_pendulum", "--out", out,
                "--seed", "7", "--effects", "coulomb_friction", "--workers", "1")  # fmt: skip
    assert code == 0
    shown = capsys.readouterr().out
    assert shown.startswith("Named: coulomb friction in pivot.")
    assert str(out / "gap.html") in shown and f"loco gap next {out}" in shown
    assert found["params"].seed == 7
    assert tuple(found["params"].effects) == ("coulomb_friction",)


def test_a_recording_that_is_held_out_is_never_fitted(found, tmp_path):
    job = runner.Job("servo_pendulum", ("chirp", "./steps"), ("steps",))
    runner.run(job, tmp_path / "out")
    assert len(found["fit"]) == len(found["held"]) == 1


def test_more_recordings_join_those_there_are(found, tmp_path):
    out = tmp_path / "out"
    assert call("chirp", "steps", "--robot", "servo_pendulum", "--out", out, "--seed", "3") == 0
    assert call(out, "--add", "more") == 0
    assert runner.load_job(out).bags == ("chirp", "steps", "more")
    assert found["params"].seed == 3
    assert len(found["fit"]) == 2


def test_the_next_experiment_is_a_file_that_runs(found, tmp_path, capsys):
    out = tmp_path / "out"
    call("chirp", "steps", "--robot", "servo_pendulum", "--out", out)
    assert call("next", out) == 0
    path = out / "next_slow_ramp.yaml"
    assert f"loco run {path}" in capsys.readouterr().out
    experiment = load_experiment(str(path))
    assert experiment.target.kind == "triangle"
    assert experiment.effects == ()
    rubbing = tmp_path / "rubbing.yaml"
    Model("servo_pendulum", {}, [{"name": "coulomb_friction", "torque": 0.1}]).save(rubbing)
    hidden = load_experiment(str(path), {"robot": str(rubbing)})  # as loco run --set does
    assert hidden.effects[0]["torque"] == 0.1


def test_the_library_of_a_robot_is_written_as_files_that_load(tmp_path):
    made = following.write_library("linear_axis", tmp_path)
    assert {p.stem for p in made} == {e.name for e in pool.pool(Model("linear_axis"))}
    for path in made:
        again, meant = load_experiment(str(path)), pool.choose(
            pool.pool(Model("linear_axis")), path.stem
        )  # fmt: skip
        assert again.target.kind == meant.target.kind
        assert again.duration == meant.duration


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ((), "at least one recording"),
        (("bag",), "wants --robot"),
        (("bag", "--robot", "nobody"), "tigrillo"),
        (("nowhere", "--robot", "tigrillo"), "nowhere"),
        (("bag", "--robot", "tigrillo", "--workers", "0"), "at least 1, got 0"),
        (("bag", "--robot", "tigrillo", "--seed", "-1"), "seed"),
        (("bag", "--robot", "tigrillo", "--effects", "magic"), "no effect named 'magic'"),
        (("bag", "--add", "more"), "holds no job.json"),
        (("a", "b", "--add", "more"), "takes one folder of results"),
        (("next", "nowhere"), "nowhere holds no gap.json"),
        (("experiments", "nobody"), "tigrillo"),
    ],
)
def test_every_mistake_is_one_line_and_exit_code_2(
    arguments, message, capsys, tmp_path, monkeypatch
):
    monkeypatch.chdir(tmp_path)
    assert call(*arguments) == 2
    error = capsys.readouterr().err
    assert message in error
    assert len(error.strip().splitlines()) == 1
    assert not list(tmp_path.iterdir())


def test_a_folder_with_other_files_is_not_touched(tmp_path):
    (tmp_path / "photo.jpg").touch()
    with pytest.raises(ParameterError, match="holds other files"):
        runner.claim(tmp_path, runner.JOB)
    with pytest.raises(ParameterError, match="is a file"):
        runner.claim(tmp_path / "photo.jpg", runner.JOB)
    runner.claim(tmp_path / "new", runner.JOB)


def test_results_of_another_kind_are_refused(tmp_path):
    for content in ("nothing", "[]", '{"format": 99}'):
        (tmp_path / "job.json").write_text(content)
        with pytest.raises(LocoError):
            runner.load_job(tmp_path)


def test_a_rank_that_is_not_proposed_is_refused(tmp_path):
    runner.write_json(tmp_path / "gap.json", result(next=[]))
    with pytest.raises(LocoError, match="proposes no experiment: nothing is left"):
        following.write_next(tmp_path)


def test_a_robot_given_by_its_path_is_found_from_the_model_file(tmp_path):
    (tmp_path / "robot").mkdir()
    (tmp_path / "robot/robot.yaml").write_text("x")
    there = Model(str(tmp_path / "robot/robot.yaml"))
    assert runner.relocated(there, tmp_path / "out").robot == "../robot/robot.yaml"
    assert runner.relocated(Model("tigrillo"), tmp_path).robot == "tigrillo"


def test_the_help_names_every_option_of_the_tutorial():
    shown = parser("gap").format_help()
    for option in (
        "--robot",
        "--mapping",
        "--hold-out",
        "--add",
        "--out",
        "--free",
        "--effects",
    ):
        assert re.search(rf"{option}\b", shown)


JOB = {"format": 1, "robot": "servo_pendulum", "bags": ["a.csv"], "hold_out": [], "mapping": "",
       "options": {}}  # fmt: skip


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"robot": 3}, "job.json: robot must be a text, got 3"),
        ({"bags": "a.csv"}, "job.json: bags must be a list, each a text"),
        ({"bags": [1]}, r"job.json: bags\[0\] must be a text, got 1"),
        ({"bags": []}, "job.json: bags must name one recording or more"),
        ({"hold_out": None}, "job.json: hold_out must be a list"),
        ({"options": [1]}, "job.json: options must be a mapping"),
        ({"format": 7}, "job.json is not of format 1"),
    ],
)
def test_a_job_of_others_is_read_key_by_key(tmp_path, change, words):
    (tmp_path / "job.json").write_text(json.dumps(JOB | change))
    with pytest.raises(LocoError, match=words):
        runner.load_job(tmp_path)
    (tmp_path / "job.json").write_text(
        json.dumps({k: v for k, v in JOB.items() if k not in change})
    )
    with pytest.raises(LocoError, match="job.json"):
        runner.load_job(tmp_path)


@pytest.mark.parametrize(
    "options", [{"effects": 3}, {"effects": [3]}, {"seed": "a"}, {"seed": 1e300}]
)
def test_options_of_a_job_are_those_of_the_command(options):
    with pytest.raises(LocoError, match=f"gap.{next(iter(options))}"):
        runner.options_of(runner.Job("servo_pendulum", ("a.csv",), options=options))


@pytest.mark.parametrize(
    ("change", "words"),
    [
        ({"next": 3}, "gap.json: next must be a list"),
        ({"next": [{"experiment": 3}]}, r"gap.json: next\[0\].experiment must be a text, got 3"),
        ({"next": [{}]}, r"gap.json: next\[0\] lacks the key 'experiment'"),
        ({"next": [{"experiment": "x", "odds": "a"}]}, r"next\[0\].odds must be a finite number"),
        ({"terms": {"effect": 1}}, "gap.json: terms must be a list"),
        ({"terms": [{"effect": "a", "place": "b", "parameters": {"c": {"value": 1e999}}}]},
         r"gap.json: terms\[0\].parameters.c.value must be a finite number"),
        ({"verdict": None}, "gap.json: verdict must be a text"),
    ],
)  # fmt: skip
def test_a_result_of_others_is_read_key_by_key(tmp_path, change, words):
    (tmp_path / "gap.json").write_text(json.dumps(result() | change))
    (tmp_path / "job.json").write_text(json.dumps(JOB))
    with pytest.raises(LocoError, match=words) as error:
        following.write_next(tmp_path)
    assert "\n" not in str(error.value)
