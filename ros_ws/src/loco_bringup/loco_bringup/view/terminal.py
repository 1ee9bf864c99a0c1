# SPDX-License-Identifier: Apache-2.0
"""Terminal command `loco view`."""

from __future__ import annotations

import argparse
from pathlib import Path

from loco_control.exceptions import ParameterError

from ..bag.foreign.opening import open_bag
from ..logs.bag_log import read_log
from ..logs.recording import is_foreign
from ..terminal import console
from . import gap_scene
from .rerun_scene import show
from .scene import Scene, scene_of


def show_view(a: argparse.Namespace) -> int:
    """Show bags or results of `loco gap` in Rerun, or write a Rerun recording.

    Raises:
        ParameterError: No bag is given, two have the same name, results of a gap are combined with
            other paths, a recording of another program is shown without its robot or with other
            paths, or the file exists already.
    """
    if not a.bag:
        raise ParameterError("name a bag to show; `loco list` shows those that are here")
    names = [Path(bag).resolve().name for bag in a.bag]
    if len(set(names)) < len(names):
        raise ParameterError(f"bags of one name cannot be told apart: {', '.join(names)}")
    if a.save and a.save.exists():
        raise ParameterError(f"{a.save} is there already; choose another --save")
    if any(gaps := [gap_scene.is_gap(path) for path in a.bag]) and len(gaps) > 1:
        raise ParameterError("results of `loco gap` are three robots already; show them alone")
    if foreign := [bag for bag in a.bag if not any(gaps) and (a.robot or is_foreign(bag))]:
        scenes = _recorded(foreign, a)
    elif any(gaps):
        scenes = gap_scene.scenes_of(a.bag[0])
    else:
        scenes = {n: scene_of(read_log(open_bag(b))) for n, b in zip(names, a.bag, strict=True)}
    show(scenes, a.save)
    if a.save:
        console.print(f"{a.save}: open it with `rerun {a.save}`")
    return 0


def _recorded(bags: list[Path], a: argparse.Namespace) -> dict[str, Scene]:
    """Scenes of a recording of another program."""
    if len(a.bag) > 1:
        raise ParameterError(f"{bags[0]} is no run of loco: show it alone, beside its model")
    if not a.robot:
        raise ParameterError(
            f"{bags[0]} is no run of loco, so its robot is unknown: name it by --robot "
            "(`loco robot new URDF` makes one)"
        )
    return gap_scene.recorded(bags[0], a.robot, a.mapping)
