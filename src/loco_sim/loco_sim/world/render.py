# SPDX-License-Identifier: Apache-2.0
"""Headless rendering of a recorded run as an animated GIF."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from loco_control.exceptions import ParameterError

from ..robot import robot as robots
from .figure import Figure
from .stage import EYE, FIELD_OF_VIEW, Stage, look_at, perspective

FULL_SIZE = 0.9  # size below which the camera distance is scaled down [m]
CLOSER, FILLED = 1.05, 0.85  # step factor of the camera distance; share of the picture to fill
CLOSEUP = 4.0  # initial camera position, times nearer than for a walking robot
LOOKED_AT = 50  # number of poses of a fixed-base robot that must be in view
LOWEST = -0.4  # smallest height of the point looked at, for a robot of full size [m]
FOLLOW = 0.5  # averaging time of the position followed by the camera [s]


def render_gif(
    path: str | Path | None,
    t: np.ndarray,
    position: np.ndarray,
    orientation: np.ndarray,
    q: np.ndarray,
    fps: float = 25.0,
    size: tuple[int, int] = (480, 320),
    **options: Any,
) -> bytes:
    """Write an animated GIF of a run.

    Args:
        path: File to write; None to only return the bytes.
        t: Time of each sample [s], (T,), increasing.
        position: Base origin in the world [m], (T, 3).
        orientation: Base to world, x y z w, (T, 4).
        q: Joint positions [rad], (T, n).
        fps: Frames per second; GIF supports 100, 50, 33.3, 25, 20 …
        size: Width and height [pixel].
        options: Further arguments of `frames`.

    Returns:
        The GIF's bytes.

    Raises:
        ParameterError: The arrays are empty or do not fit together.
    """
    pictures = list(frames(t, position, orientation, q, fps, size, **options))
    # One palette for all frames; otherwise colours flicker and the file size doubles.
    sheet = Image.new("RGB", (size[0], 3 * size[1]))
    for i, k in enumerate((0, len(pictures) // 2, len(pictures) - 1)):
        sheet.paste(pictures[k], (0, i * size[1]))
    palette = sheet.quantize(colors=255, method=Image.Quantize.MEDIANCUT)
    images = [p.quantize(palette=palette, dither=Image.Dither.NONE) for p in pictures]
    buffer = BytesIO()
    images[0].save(
        buffer,
        format="GIF",
        save_all=True,
        append_images=images[1:],
        duration=max(10, 10 * round(100.0 / fps)),
        loop=0,
        optimize=False,
    )
    data = buffer.getvalue()
    if path is not None:
        Path(path).write_bytes(data)
    return data


def frames(
    t: np.ndarray,
    position: np.ndarray,
    orientation: np.ndarray,
    q: np.ndarray,
    fps: float = 25.0,
    size: tuple[int, int] = (480, 320),
    robot: str | robots.Robot = "hyq",
    speed: float = 1.0,
) -> Iterator[Image.Image]:
    """Pictures of a run in sequence.

    Args:
        t: Time of each sample [s], (T,), increasing.
        position: Base origin in the world [m], (T, 3).
        orientation: Base to world, x y z w, (T, 4).
        q: Joint positions [rad], (T, n).
        fps: Frames per second.
        size: Width and height [pixel].
        robot: Name, path or `Robot`.
        speed: Playback speed; 1 is real time, 0.5 half as fast.

    Raises:
        ParameterError: The arrays are empty or do not fit together.
    """
    t, position, orientation, q = (np.asarray(x, float) for x in (t, position, orientation, q))
    robot = robot if isinstance(robot, robots.Robot) else robots.load(robot)
    _check(t, position, orientation, q, len(robot.joints))
    figure = Figure(robot)
    if not len(figure.corners(0.0)):
        raise ParameterError(f"robot {robot.name!r} has nothing that could be drawn")
    poses = list(zip(position, orientation, q, strict=True))
    stage, middle = camera(figure, size, poses if robot.fixed_base else [])
    for instant in np.arange(t[0], t[-1] + 1e-9, speed / fps):
        k = min(int(np.searchsorted(t, instant - 1e-9)), len(t) - 1)
        window = np.abs(t - t[k]) <= 0.5 * FOLLOW
        figure.pose(position[k], orientation[k], q[k])
        centre = position[window].mean(axis=0) if middle is None else middle
        yield _labelled(stage.draw(figure, centre), f"t = {t[k]:.2f} s")


def camera(
    figure: Figure, size: tuple[int, int], poses: Sequence[tuple[np.ndarray, ...]]
) -> tuple[Stage, np.ndarray | None]:
    """Camera with the whole robot in view, and the point that it looks at.

    Args:
        figure: The robot in its standing pose.
        size: Width and height of the pictures [pixel].
        poses: Position, orientation and joints of a stationary robot, all of which will be in
            view. Empty for a walking robot, which the camera follows; the point is then None.
    """
    if not poses:
        extent = np.ptp(figure.corners(0.0), axis=0).max()
        return Stage(size, scale=min(1.0, extent / FULL_SIZE)), None
    boxes = []
    for k in np.linspace(0, len(poses) - 1, min(len(poses), LOOKED_AT)).astype(int):
        figure.pose(*poses[k])
        boxes.append(figure.corners(0.0))
    corners = np.concatenate(boxes)
    low, high = corners.min(axis=0), corners.max(axis=0)
    middle, scale = 0.5 * (low + high), float((high - low).max()) / FULL_SIZE / CLOSEUP
    while not _fits(corners, middle, scale, size):
        scale *= CLOSER
    height = max(float(middle[2]) / scale, LOWEST)  # keeps the floor below the camera
    return Stage(size, height=height, scale=scale), middle


def _fits(corners: np.ndarray, middle: np.ndarray, scale: float, size: tuple[int, int]) -> bool:
    """Whether a camera that looks at `middle` has all corners in its picture, with a margin."""
    target = np.array([*middle[:2], max(float(middle[2]), LOWEST * scale)])
    view = perspective(FIELD_OF_VIEW, size[0] / size[1], 0.1 * scale, 100.0 * scale)
    view = view @ look_at(target + scale * EYE, target)
    clip = np.column_stack([corners, np.ones(len(corners))]) @ view.T
    return bool(np.all(clip[:, 3] > 0.0) and np.all(np.abs(clip[:, :2]) < FILLED * clip[:, 3:]))


def _check(t: np.ndarray, position: np.ndarray, orientation: np.ndarray, q: np.ndarray, n: int):
    expected = {"position": (len(t), 3), "orientation": (len(t), 4), "q": (len(t), n)}
    got = {"position": position.shape, "orientation": orientation.shape, "q": q.shape}
    for name, shape in expected.items():
        if got[name] != shape or len(t) == 0:
            raise ParameterError(f"{name} must have shape {shape}, T > 0, got {got[name]}")


def _labelled(picture: Image.Image, text: str) -> Image.Image:
    font = ImageFont.load_default(max(11, picture.height // 24))
    place = (picture.height // 30, picture.height - picture.height // 14)
    ImageDraw.Draw(picture).text(place, text, fill=(70, 76, 86), font=font)
    return picture
