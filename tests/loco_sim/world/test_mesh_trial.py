# SPDX-License-Identifier: Apache-2.0
"""A mesh that ends an engine ends a child process, and is one line with the file's name."""

import json
import os

import pytest
import trimesh

from loco_control.exceptions import ParameterError
from loco_sim.engines import installed
from loco_sim.params import SimParams
from loco_sim.robot import robot as robots
from loco_sim.world import mesh_trial as trial
from loco_sim.world.world import make_world


@pytest.fixture
def arm(tmp_path, monkeypatch):
    """A robot of one mesh that is its own."""
    monkeypatch.delenv(trial.VARIABLE, raising=False)
    trimesh.creation.icosphere(1, 0.1).export(tmp_path / "part.stl")
    urdf = trial._URDF.format(name='"part.stl"', scale='"1 1 1"')
    (tmp_path / "trial.urdf").write_text(urdf)
    (tmp_path / "robot.yaml").write_text(json.dumps(trial._ROBOT))
    return robots.load(tmp_path)


@pytest.mark.parametrize("engine", installed())
def test_a_good_mesh_is_tried_once_by_each_engine_and_never_again_by_workers(
    arm, engine, monkeypatch
):
    make_world(arm, SimParams(engine=engine), 0.001).close()
    assert os.environ[trial.VARIABLE]
    monkeypatch.setattr(trial, "_try", lambda *_: pytest.fail("it was tried again"))
    make_world(arm, SimParams(engine=engine), 0.001).close()
    os.utime(arm.folder / "part.stl", ns=(5, 5))
    with pytest.raises(pytest.fail.Exception):  # another file, perhaps
        make_world(arm, SimParams(engine=engine), 0.001)


ENDS = {
    "os.kill(os.getpid(), signal.SIGSEGV)": r"ends on it \(SIGSEGV\)",
    "os.abort()": r"ends on it \(SIGABRT\)",
    "os._exit(7)": r"ends on it \(exit code 7\)",
    "os.kill(os.getpid(), signal.SIGXCPU)": "is not done with it after 60 s",
    "raise MemoryError": r"ends on it \(exit code 1\)",
    "raise ParameterError('its volume is 0')": "its volume is 0",
}


@pytest.mark.parametrize("end", ENDS)
def test_an_engine_that_ends_is_one_line_that_names_the_mesh(arm, end, tmp_path, monkeypatch):
    """The child is the trial, with an engine that meets its end at the mesh."""
    script = tmp_path / "child.py"
    script.write_text(
        "import os, signal\nfrom loco_control.exceptions import ParameterError\n"
        f"from loco_sim.world import mesh_trial as trial\ndef load(*_):\n    {end}\n"
        "trial.load = load\ntrial.main()\n"
    )
    monkeypatch.setattr(trial, "_COMMAND", (str(script),))
    with pytest.raises(ParameterError, match=ENDS[end]) as raised:
        make_world(arm, SimParams(engine=installed()[0]), 0.001)
    assert "part.stl" in str(raised.value) and "\n" not in str(raised.value)
    assert trial.VARIABLE not in os.environ


@pytest.mark.parametrize("engine", installed())
@pytest.mark.parametrize("squash", [[1.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0] * 3, [1e9] * 3])
def test_flat_thin_pointlike_and_huge_meshes_end_no_process(arm, engine, squash):
    mesh = trimesh.creation.icosphere(1, 0.1)
    mesh.apply_scale(squash)
    mesh.export(arm.folder / "part.stl")
    try:
        with_world = make_world(arm, SimParams(engine=engine), 0.001)
        with_world.rebuild([0.0])
        with_world.close()
    except ParameterError as error:
        assert "part.stl" in str(error) and "\n" not in str(error)


def test_a_robot_without_meshes_starts_no_child(monkeypatch):
    monkeypatch.setattr(trial, "_try", lambda *_: pytest.fail("there is nothing to try"))
    for name in robots.names():
        robot = robots.load(name)
        make_world(robot, robot.sim, 0.001).close()
        assert "<mesh" not in robot.urdf
