# SPDX-License-Identifier: Apache-2.0
"""Modules load when they are used; whoever lists effects loads no compiler."""

import subprocess
import sys

import pytest

from loco_sim import lazy


def test_a_module_loads_at_its_first_use():
    code = (
        "import sys, loco_sim.effects as e;"
        "print('numba' in sys.modules, len(e.names()) > 20);"
        "from loco_sim.effects.catalogue import sensor;"
        "sensor.reading_laws.scale;"
        "print('numba' in sys.modules)"
    )
    found = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert found.stdout.split() == ["False", "True", "True"]


def test_the_supervisor_of_a_graph_loads_no_compiler():
    code = "import sys, loco_bringup.cli.run; print({'numba', 'scipy'} & set(sys.modules))"
    found = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert found.stdout == "set()\n"


def test_who_only_looks_at_a_robot_loads_no_interpolation():
    code = (
        "import sys; from loco_sim.robot import robot; found = robot.load('tigrillo');"
        "print('scipy' in sys.modules);"
        "sensor = next(iter(found.hall.values()));"
        "print(sensor.angle(sensor.counts(0.0)) == sensor.reached(0.0) or 'scipy' in sys.modules)"
    )
    found = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert found.stdout.split() == ["False", "True"]


def test_a_loaded_module_is_itself():
    assert lazy.module("loco_sim.lazy") is lazy


def test_a_module_that_is_not_there_is_named():
    with pytest.raises(ModuleNotFoundError, match="loco_sim.nowhere"):
        lazy.module("loco_sim.nowhere")
