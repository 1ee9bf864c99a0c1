# SPDX-License-Identifier: Apache-2.0
"""Bags that were tracebacks once, or left files behind: refused, and nothing is left."""

import base64
import json

import pytest

from loco_bringup.bag.copy import extract
from loco_bringup.bag.reader import Bag
from loco_bringup.bag.recover import recover
from loco_bringup.gap import importing
from loco_bringup.logs.export import export
from loco_control.exceptions import BagError, ParameterError
from loco_sim.robot import robot as robots
from loco_workshop.fuzz import bags, fuzz
from loco_workshop.fuzz.targets import TARGETS

NESTED = "[" * 500 + "]" * 500


def changed(change):
    """Recipe of a bag with a change to its values."""
    values = json.loads(bags.recipes()[0])
    change(values)
    return json.dumps(values).encode()


def first(values):
    return values["channels"][0]


def bag(folder, data):
    place = folder / "bag"
    place.mkdir()
    (place / "bag_0.mcap").write_bytes(data)
    return place


def late(values):
    first(values)["messages"][3]["time"] = 2**63


def short(values):
    row = first(values)["messages"][3]
    row["data"] = base64.b64encode(base64.b64decode(row["data"])[:40]).decode()


FINDS = {
    "a stamp of 2^63 ns": late,
    "CDR cut short": short,
    "a definition that is none": lambda v: first(v)["schema"].update(text="&a [*a]"),
    "a default that is no value": lambda v: first(v)["schema"].update(text="float64 x [[["),
    "another message of that name": lambda v: first(v)["schema"].update(text="float64 x"),
    "a name that leads out of the folder": lambda v: first(v).update(topic="/../../x"),
    "a topic that is not of ROS": lambda v: first(v).update(encoding="json"),
    "nested QoS": lambda v: first(v)["metadata"].update(offered_qos_profiles=NESTED),
}


@pytest.mark.parametrize("name", FINDS)
def test_a_bag_that_cannot_be_is_refused_and_leaves_nothing(name):
    kind, why = fuzz.outcome(TARGETS["bag"], changed(FINDS[name]))
    assert kind == "refused", why


def test_a_recipe_in_order_reads_in_every_way(tmp_path):
    bags.read_recipe(bags.recipes()[1], tmp_path)


def test_recovery_leaves_a_message_of_no_time_out_and_says_so(tmp_path):
    recovery = recover(bag(tmp_path, bags.made(changed(late))), tmp_path / "out")
    assert recovery.lost == 1
    assert any("stamp of 2^63 ns" in note for note in recovery.notes)
    assert Bag(tmp_path / "out").topics["/joint_states"].count == 59


def test_an_export_that_fails_leaves_no_file_and_no_folder(tmp_path):
    place = bag(tmp_path, bags.made(changed(short)))
    with pytest.raises(BagError, match="40 bytes are no sensor_msgs/msg/JointState"):
        export(place, tmp_path / "new" / "out")
    assert sorted(path.name for path in tmp_path.rglob("*")) == ["bag", "bag_0.mcap"]


def test_an_extract_that_fails_leaves_no_bag(tmp_path):
    data = bags.made(bags.recipes()[2], sums=False)
    place = bag(tmp_path, data.replace(b"string frame_id", b"string \xfframe_id"))
    with pytest.raises(ParameterError, match="type of /joint_states.*not UTF-8"):
        extract(place, tmp_path / "out", ["joint_states"])
    assert not (tmp_path / "out").exists()


def test_messages_of_another_definition_are_no_recording(tmp_path):
    change = FINDS["another message of that name"]
    with pytest.raises(ParameterError, match="is not a whole recording: .*'(position|name)'"):
        importing.load(bag(tmp_path, bags.made(changed(change))), robots.load("servo_pendulum"))
