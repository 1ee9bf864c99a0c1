# SPDX-License-Identifier: Apache-2.0
"""Display of scenes in Rerun: moving links, force arrows, curves; in a file or the viewer."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from scipy.spatial.transform import Rotation

from .scene import Scene

TIMELINE = "sim_time"
NEWTONS_PER_METRE = 1000.0  # scale of the force arrows [N/m]
GHOST = 0.35  # opacity of every robot but the first
PART = 50.0  # largest sampling rate of curves and link poses [Hz]


def show(scenes: Mapping[str, Scene], save: Path | None = None) -> None:
    """Write scenes to one recording, with common time axis and world frame.

    Args:
        scenes: Scenes by the name of their run; the first is solid, the others are ghosts.
        save: File to write, ``.rrd``; None starts the viewer.
    """
    stream = rr.RecordingStream("loco")
    if save is None:
        stream.spawn()
    else:
        stream.save(save)
    stream.send_blueprint(_layout(scenes))
    stream.log("/", rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
    for number, (name, scene) in enumerate(scenes.items()):
        _write(stream, name, scene, GHOST if number else 1.0)
    stream.flush()


def _write(stream: rr.RecordingStream, name: str, scene: Scene, opacity: float) -> None:
    every = max(1, round(1.0 / (PART * float(np.median(np.diff(scene.t))))))
    rows = slice(None, None, every)
    when = [rr.TimeColumn(TIMELINE, duration=scene.t[rows])]
    for link, turn in scene.turns.items():
        path = f"robots/{name}/{link}"
        if link in scene.shapes:
            stream.log(f"{path}/shape", _mesh(*scene.shapes[link], opacity), static=True)
        quaternion = Rotation.from_matrix(turn[rows]).as_quat()
        stream.send_columns(path, when, rr.Transform3D.columns(
            translation=scene.places[link][rows], quaternion=quaternion))  # fmt: skip
    for foot, force in scene.forces.items():
        stream.send_columns(f"forces/{name}/{foot}", when, rr.Arrows3D.columns(
            origins=scene.places[foot][rows], vectors=force[rows] / NEWTONS_PER_METRE))  # fmt: skip
    for signal, values in scene.signals.items():
        group, _, curve = signal.partition("/")
        stream.send_columns(
            f"signals/{group}/{name}/{curve}", when, rr.Scalars.columns(scalars=values[rows])
        )
    for phase, t in scene.phases.items():
        stream.set_time(TIMELINE, duration=t)
        stream.log(f"phase/{name}", rr.TextLog(phase))


def _mesh(triangles: np.ndarray, colours: np.ndarray, opacity: float) -> rr.Mesh3D:
    paint = np.concatenate((colours, np.full((len(colours), 1), opacity)), axis=1)
    corners = triangles.reshape(-1, 3)
    return rr.Mesh3D(
        vertex_positions=corners,
        triangle_indices=np.arange(len(corners)).reshape(-1, 3),
        vertex_colors=np.repeat((255.0 * paint).astype(np.uint8), 3, axis=0),
    )


def _layout(scenes: Mapping[str, Scene]) -> rrb.Blueprint:
    """Layout: robots at the left, one plot per group of curves at the right, phases below."""
    groups = dict.fromkeys(s.partition("/")[0] for scene in scenes.values() for s in scene.signals)
    plots = [rrb.TimeSeriesView(origin=f"signals/{group}", name=group) for group in groups]
    world = rrb.Spatial3DView(origin="/", contents=["robots/**", "forces/**"], name="robots")
    left = rrb.Vertical(world, rrb.TextLogView(origin="phase", name="phases"), row_shares=[5, 1])
    return rrb.Blueprint(rrb.Horizontal(left, rrb.Vertical(*plots), column_shares=[3, 2]))
