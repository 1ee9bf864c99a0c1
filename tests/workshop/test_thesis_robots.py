# SPDX-License-Identifier: Apache-2.0
"""The thesis's robots: their recordings, and the comparison with models."""

from __future__ import annotations

from dataclasses import replace

import pytest

from loco_bringup.gap.importing import load
from loco_sim.plant import model as models
from loco_workshop import thesis_robots

pytest.importorskip("pybullet")
SHORT = {
    "hyq": {"learner.stand": 0.5, "learner.train": 0.7},
    "tigrillo": {"duration": 1.2},
}


@pytest.mark.parametrize("name", thesis_robots.SUBJECTS)
def test_a_recording_is_read_and_only_the_robot_itself_repeats_it(tmp_path, name):
    subject = thesis_robots.SUBJECTS[name]
    short = SHORT[subject.known.robot]
    records = {bag: (what, {**values, **short}) for bag, (what, values)
               in subject.records.items()}  # fmt: skip
    subject = replace(subject, records=records, brink=())
    folder = tmp_path / "bags"
    thesis_robots.record(subject, folder)
    real, known = (models.load_any(folder / f"{which}.yaml") for which in ("real", "known"))
    assert real == subject.real and known == subject.known and not known.effects
    for bag in records:
        (record,) = load(folder / bag, real.make_robot())
        assert record.duration > 1.1
    motion = subject.records["held_out"]
    measured = thesis_robots.run(folder / "real.yaml", motion)
    again = thesis_robots.run(folder / "real.yaml", motion)
    assert set(thesis_robots.nrmse(measured, again).values()) == {0.0}
    lines = list(thesis_robots.replay(subject, folder, {"known": folder / "known.yaml"}))
    without, itself = ([float(x) for x in line.split(" | ")[1:6]] for line in lines[-2:])
    assert min(without) > 0.0 and max(itself) > 0.0  # the last one has other noise
    assert name == "hyq" or sum(without) > sum(itself)  # nothing random pushes Tigrillo
