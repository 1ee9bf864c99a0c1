# SPDX-License-Identifier: Apache-2.0
"""The page about effects has all of them, each with its picture; their bench runs."""

import pytest
from PIL import Image

from loco_bringup.cli.clone import root
from loco_sim import effects
from loco_sim.effects.base import EFFECTS
from loco_workshop.bench import effects as bench_effects
from loco_workshop.docs.effects_figures import draw
from loco_workshop.docs.effects_fingerprints import FINGERPRINTS
from loco_workshop.docs.effects_page import page

PICTURES = root() / "docs" / "pictures" / "effects"


def test_every_effect_has_a_small_picture_and_no_picture_is_left_over():
    assert set(FINGERPRINTS) == set(EFFECTS)
    assert {path.stem for path in PICTURES.glob("*.png")} == set(EFFECTS)
    assert max(path.stat().st_size for path in PICTURES.glob("*.png")) < 25_000


def test_a_picture_can_be_drawn_again(tmp_path):
    draw("coulomb_friction", tmp_path / "drawn.png")
    with (
        Image.open(tmp_path / "drawn.png") as new,
        Image.open(PICTURES / "coulomb_friction.png") as old,
    ):
        assert new.size == old.size
        assert len(new.convert("RGB").getcolors()) > 2


def test_the_page_tells_what_is_known():
    for name in effects.names():
        known = EFFECTS[name].identity
        text = "\n".join(page(known.site))
        assert f"## {name}" in text
        assert known.equation in text
        assert known.source in text
        for other in known.look_alikes:
            site = EFFECTS[other.name].identity.site
            assert f"- Similar to [{other.name}](effects_{site}.md#{other.name}). " in text
            assert all(step[1:] in text for step in other.experiment.split(": "))


@pytest.mark.pybullet
def test_the_bench_has_a_row_per_robot(monkeypatch):
    monkeypatch.setattr(bench_effects, "BLOCK", 1)
    monkeypatch.setattr(bench_effects, "BLOCKS", 2)
    monkeypatch.setattr(bench_effects, "_least", lambda call, *_: (call(), 1.0)[1])
    rows = bench_effects.bench_effects()
    assert [row["robot"] for row in rows] == list(bench_effects.ROBOTS)
    assert [row["effects"] for row in rows] == [50, 53]
