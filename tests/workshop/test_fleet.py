# SPDX-License-Identifier: Apache-2.0
"""The fleet with planted faults: its recordings, and the score of an answer."""

from loco_bringup.gap.importing import load
from loco_sim.plant import model as models
from loco_workshop import fleet


def test_recordings_lie_by_robot_and_day_and_are_made_once(tmp_path):
    assert fleet.write(tmp_path, 1, 2, 1, 3, pieces=1) == 2
    robot = models.load_any(str(tmp_path / "robot" / "kuka_iiwa.yaml")).make_robot()
    first, second = (tmp_path / "arm_1" / f"day_{d}" / "run_1" for d in (1, 2))
    (record,) = load(first, robot)
    assert record.duration > 3.9 and len(record.joints) == 7
    before = {path: path.stat().st_mtime_ns for path in first.iterdir()}
    (second / "metadata.yaml").unlink()  # as if it had been stopped
    assert fleet.write(tmp_path, 1, 2, 1, 3, pieces=1) == 2
    assert (second / "metadata.yaml").is_file()
    assert before == {path: path.stat().st_mtime_ns for path in first.iterdir()}


def answer(robot, effect, place, day):
    """A robot with an effect, as in ``fleet.json``."""
    one = {"effect": effect, "place": place, "day": day, "size": 1.01, "has": True}
    return {"robot": robot, "effects": [one], "unexplained": 0}


def test_a_name_counts_with_its_place_and_day():
    rows = [
        answer("arm_2", "coulomb_friction", "lbr_iiwa_joint_4", "day_4"),
        answer("arm_5", "payload", "lbr_iiwa_link_6", None),
        {"robot": "arm_1", "effects": [], "unexplained": 2},
    ]
    friction, payload, healthy = fleet.score({"robots": rows}, 6)
    assert friction == "arm_2: right 1.01 of 1"
    assert payload.startswith("arm_5: wrong")
    assert healthy == "arm_1: right, 2 unexplained"
    rows[0]["effects"][0]["day"] = "day_5"
    assert fleet.score({"robots": rows}, 6)[0].startswith("arm_2: wrong")
