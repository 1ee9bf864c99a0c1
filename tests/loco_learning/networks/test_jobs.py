# SPDX-License-Identifier: Apache-2.0
"""Chapter 6 on a small scale: jobs, resuming, verdicts, page."""

import dataclasses

import numpy as np
import pytest

from loco_control.exceptions import NameUnknownError
from loco_learning.networks import jobs as msd_jobs
from loco_learning.networks import page as msd_page
from loco_learning.networks.claims import CLAIMS, judge
from loco_learning.networks.jobs import PLANS, Curves
from loco_learning.networks.reservoir import LOOPS
from loco_learning.networks.results import Results, knee, load, roughness

TINY = msd_jobs.Plan(
    nodes=(3, 5, 6, 8, 20),
    repetitions=1,
    budget=(0, 20),
    omega_nodes=(5, 10),
    frequencies=(0.5, 2.0, 6.0),
    omega_repetitions=1,
    omega_evaluations=20,
    powers=(500.0, 5e3, 2e4),
    power_frequencies=(3.0,),
    power_repetitions=1,
    power_evaluations=20,
    loop_repetitions=1,
    noises=(1e-4, 1e-2, 1.0),
    regularisations=(0.01, 1.0),
)


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """A tiny plan, run in this process."""
    patch = pytest.MonkeyPatch()
    patch.setitem(PLANS, "tiny", TINY)
    short = LOOPS["thesis"].replace(train=12.0, closing=1.0, test=10.0)
    patch.setitem(LOOPS, "thesis", short)
    folder = tmp_path_factory.mktemp("msd")
    told = []
    msd_jobs.run("tiny", "thesis", folder, 1, "", lambda *state: told.append(state))
    total = 5 + 6 + 3 + 5 + 2 + 1
    assert told[-1][:2] == (total, total)
    yield folder
    patch.undo()


def test_a_second_run_finds_everything_done(folder):
    told = []
    before = {path: path.stat().st_mtime_ns for path in folder.iterdir()}
    msd_jobs.run("tiny", "thesis", folder, 1, "", lambda *state: told.append(state))
    assert told == []
    assert before == {path: path.stat().st_mtime_ns for path in folder.iterdir()}


def test_a_lost_or_foreign_file_is_made_again_with_the_same_numbers(folder):
    old = load("tiny", "thesis", folder)
    (folder / "omega_5_0_0.npz").unlink()
    (folder / "loop_6_0.npz").write_bytes((folder / "loop_5_0.npz").read_bytes())
    told = []
    msd_jobs.run("tiny", "thesis", folder, 1, "", lambda *state: told.append(state[2]))
    assert sorted(told) == ["loop_6_0", "omega_5_0_0"]
    new = load("tiny", "thesis", folder)
    assert new.omega[5, 0, 0].best == old.omega[5, 0, 0].best
    np.testing.assert_array_equal(new.loops[6, 0].arrays["error"], old.loops[6, 0].arrays["error"])


def test_every_claim_gets_a_verdict_with_numbers(folder):
    verdicts = judge(load("tiny", "thesis", folder))
    assert [v.claim for v in verdicts] == [f"6.{k}" for k in range(1, 17)]
    for v in verdicts:
        assert v.verdict in ("agrees", "disagrees") or "still rose" in v.found, v
        assert any(c.isdigit() for c in v.found)
    by_number = {v.claim: v.verdict for v in verdicts}
    assert by_number["6.16"] == by_number["6.5"] == "agrees"


def test_claims_without_results_are_not_decided():
    verdicts = judge(Results())
    assert len(verdicts) == len(CLAIMS) == 16
    assert {v.verdict for v in verdicts if v.claim != "6.5"} == {"not decided"}


def test_the_page_shows_all_figures_and_seeds(folder, tmp_path):
    _, _, drawn = msd_page.write("tiny", "thesis", folder, tmp_path)
    text = (tmp_path / "README.md").read_text()
    assert list(drawn) == list(msd_page.CAPTIONS)
    for number in msd_page.CAPTIONS:
        file = f"figure_{number.replace('.', '_')}.png"
        assert (tmp_path / file).stat().st_size > 3000
        assert file in text
    rows = (tmp_path / "gaits.csv").read_text().splitlines()
    assert len(rows) == 1 + 5 + 6 + 3


def test_two_processes_give_the_same_files(folder, tmp_path, monkeypatch):
    small = dataclasses.replace(
        TINY, nodes=(5, 6), omega_nodes=(), powers=(), loop_repetitions=0, regularisations=(),
        noises=(),
    )  # fmt: skip
    monkeypatch.setitem(PLANS, "small", small)
    msd_jobs.run("small", "thesis", tmp_path, 2)
    one, two = (load("small", "thesis", place) for place in (folder, tmp_path))
    assert one.gaits[6, 0].best == two.gaits[6, 0].best


def test_plans_are_named_and_the_full_one_is_that_of_the_thesis():
    with pytest.raises(NameUnknownError, match="full, medium, quick"):
        msd_jobs.plan("fast")
    full = msd_jobs.plan("full")
    assert full.nodes == tuple(range(3, 27))
    assert full.repetitions == full.omega_repetitions == full.power_repetitions == 5


def test_a_search_that_has_not_levelled_off_leaves_a_verdict_open(folder):
    results = load("tiny", "thesis", folder)
    for key, g in results.powers.items():
        course = np.linspace(0.1, 1.0, 40)[:, None] * np.ones(3)
        results.powers[key] = dataclasses.replace(g, course=course)
    power = {v.claim: v for v in judge(results)}["6.8"]
    assert power.verdict == "not decided"
    assert "100% of the searches still rose" in power.found


def test_measures_of_known_curves():
    noise = np.logspace(-6, 0, 61)
    distance = np.where(noise < 0.03, 10.0, 2.0)[:, None]
    assert knee(Curves({}, {"noise": noise, "distance": distance})) == pytest.approx(0.02, rel=0.6)
    t = np.arange(0.0, 10.0, 0.02)
    circle = np.stack([np.cos(2 * np.pi * t), np.sin(2 * np.pi * t)], axis=1)
    turning = Curves({"period": 1.0}, {"t": t, "cycle": circle})
    assert roughness(turning) < 1e-9
    still = Curves({"period": 1.0}, {"t": t, "cycle": 0.0 * circle})
    assert roughness(still) == np.inf
    noisy = circle + np.random.default_rng(0).normal(size=circle.shape)
    assert roughness(Curves({"period": 1.0}, {"t": t, "cycle": noisy})) > 0.5
