# SPDX-License-Identifier: Apache-2.0
"""Camera, checkered floor, sky and soft shadow around a robot, in NumPy.

`Figure` draws the robot only, in a picture no larger than the robot, since its time is
proportional to the number of pixels.
"""

from __future__ import annotations

import numpy as np
from PIL import Image, ImageFilter

from ..jit import njit
from .figure import Figure

MADE_OF = "84ef97f06718"  # of the called kernels, see tests/loco_sim/test_kernel_caches.py

EYE = np.array([1.15, -2.05, 0.55])  # from the point looked at to the camera [m]
FIELD_OF_VIEW = np.radians(34.0)  # vertical
LIGHT = np.array([0.35, -0.55, 1.0]) / np.linalg.norm([0.35, -0.55, 1.0])  # towards the light
SUN = 20.0  # distance of the light [m]
SHADOW_PIXELS, SHADOW_SPAN, DARKNESS = 288, 2.4, 0.45  # [pixel], [m], [-]
TILE = 0.25  # [m]
TILES = np.array([[0.93, 0.94, 0.95], [0.80, 0.82, 0.85]])
SKY, HORIZON = np.array([0.78, 0.86, 0.94]), np.array([0.97, 0.98, 0.99])
FOG = 5.0  # distance over which the floor fades into the horizon [m]
SAMPLES = 2  # supersampling factor of the robot


class Stage:
    """A camera that keeps its direction and moves with the robot.

    Constant parts of the pictures are computed once.

    Args:
        size: Width and height of the pictures [pixel].
        height: Height of the point looked at, for a robot of full size [m].
        scale: Size of the robot relative to full size (about a metre), for which the constants are.
    """

    def __init__(self, size: tuple[int, int], height: float = 0.40, scale: float = 1.0):
        height *= scale
        self.size, self._height, self._scale = size, height, scale
        self._eye, self._tile = scale * EYE, scale * TILE
        wide, high = size
        self._projection = perspective(FIELD_OF_VIEW, wide / high, 0.1 * scale, 100.0 * scale)
        rays = self._rays()
        self._down = rays[:, :, 2] < -1e-6
        rise = (rays[:, :, 2] / np.linalg.norm(rays, axis=-1)).clip(0.0, 1.0)
        self._sky = HORIZON + (SKY - HORIZON) * np.sqrt(rise)[..., None]
        reach = -(height + self._eye[2]) / rays[:, :, 2][self._down]
        self._ground = self._eye[:2] + reach[:, None] * rays[self._down][:, :2]  # from the target
        fog = 1.0 - np.exp(-((reach / (FOG * scale)) ** 2))
        # Width of a pixel on the ground, in tiles, along the ray and across it.
        across = 2.0 * np.tan(0.5 * FIELD_OF_VIEW) / high * reach / self._tile
        blur = across * np.sqrt(1.0 + (reach / (height + self._eye[2])) ** 2)
        self._floor = np.column_stack([self._ground, fog, blur.clip(1e-3)])
        self._where = np.flatnonzero(self._down)

    def _rays(self) -> np.ndarray:
        """Direction of each pixel in the world, not normalised, (height, width, 3)."""
        wide, high = self.size
        x = (2.0 * np.arange(wide) + 1.0) / wide - 1.0
        y = 1.0 - (2.0 * np.arange(high) + 1.0) / high
        u, v = np.meshgrid(x / self._projection[0, 0], y / self._projection[1, 1])
        turn = look_at(EYE, np.zeros(3))[:3, :3]
        return np.stack([u, v, -np.ones_like(u)], axis=-1) @ turn

    def draw(self, figure: Figure, centre: np.ndarray) -> Image.Image:
        """Picture of the robot in its pose, looking at a point above or below `centre` [m]."""
        target = np.array([centre[0], centre[1], self._height])
        image = self._sky.copy()
        dark, lens = self._shadow(figure, target)
        lay_floor(
            image.reshape(-1, 3), self._where, self._floor, target[:2], self._tile, dark, lens
        )
        self._paint(image, figure, look_at(target + self._eye, target))
        np.multiply(image, 255.0, out=image)
        return Image.fromarray(image.clip(0.0, 255.0, out=image).astype(np.uint8))

    def _shadow(self, figure: Figure, target: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Blurred silhouette seen from the light, and its camera matrix without the depth row."""
        sun = SUN * self._scale
        view = look_at(target + sun * LIGHT, target)
        angle = 2.0 * np.arctan(0.5 * SHADOW_SPAN / SUN)
        camera = perspective(angle, 1.0, self._scale, 2.0 * sun)
        _, robot = figure.picture(view, camera, (SHADOW_PIXELS, SHADOW_PIXELS), tuple(LIGHT))
        silhouette = Image.fromarray((255 * robot).astype(np.uint8))
        blurred = np.asarray(silhouette.filter(ImageFilter.GaussianBlur(2.2)))
        return blurred, (camera @ view)[[0, 1, 3]]

    def _paint(self, image: np.ndarray, figure: Figure, view: np.ndarray) -> None:
        """Draw the robot over the image, within its bounding box."""
        left, top, right, bottom = self._box(figure.corners(0.08 * self._scale), view)
        if right <= left or bottom <= top:
            return
        wide, high = self.size
        zoom = np.diag([wide / (right - left), high / (bottom - top), 1.0, 1.0])
        zoom[0, 3] = (wide - left - right) / (right - left)
        zoom[1, 3] = (top + bottom - high) / (bottom - top)
        shape = (SAMPLES * (right - left), SAMPLES * (bottom - top))
        colour, robot = figure.picture(view, zoom @ self._projection, shape, tuple(LIGHT))
        put_over(image[top:bottom, left:right], colour, robot)

    def _box(self, points: np.ndarray, view: np.ndarray) -> tuple[int, int, int, int]:
        """Bounding box of points [pixel]: left, top, right, bottom."""
        wide, high = self.size
        clip = np.column_stack([points, np.ones(len(points))]) @ (self._projection @ view).T
        x = (0.5 + 0.5 * clip[:, 0] / clip[:, 3]) * wide
        y = (0.5 - 0.5 * clip[:, 1] / clip[:, 3]) * high
        left, right = np.clip([np.floor(x.min()), np.ceil(x.max())], 0, wide).astype(int)
        top, bottom = np.clip([np.floor(y.min()), np.ceil(y.max())], 0, high).astype(int)
        return int(left), int(top), int(right), int(bottom)


@njit()
def lay_floor(image, where, floor, centre, tile, dark, lens):
    """Colour the pixels of the floor: tiles, shadow and fog.

    Args:
        image: Colours, (pixels, 3).
        where: Pixels of the floor, (n,).
        floor: Position relative to the centre [m], fog and pixel width in tiles, (n, 4).
        centre: Point on the ground below the point looked at [m], (2,).
        tile: Size of a tile [m].
        dark: Silhouette of the robot seen from the light, (m, m), 0 to 255, with an empty border.
        lens: World to clip space of the light, without depth, (3, 4).
    """
    pixels = dark.shape[0]
    for i in range(len(where)):
        x, y = floor[i, 0] + centre[0], floor[i, 1] + centre[1]
        # A triangle wave with a period of two tiles along each axis, smoothed over a pixel.
        a = (2.0 * abs((x / tile) % 2.0 - 1.0) - 1.0) / floor[i, 3]
        b = (2.0 * abs((y / tile) % 2.0 - 1.0) - 1.0) / floor[i, 3]
        mix = 0.5 + 0.5 * min(max(a, -1.0), 1.0) * min(max(b, -1.0), 1.0)
        w = lens[2, 0] * x + lens[2, 1] * y + lens[2, 3]
        u = (lens[0, 0] * x + lens[0, 1] * y + lens[0, 3]) / w
        v = (lens[1, 0] * x + lens[1, 1] * y + lens[1, 3]) / w
        column = min(max(int((0.5 + 0.5 * u) * pixels), 0), pixels - 1)
        row = min(max(int((0.5 - 0.5 * v) * pixels), 0), pixels - 1)
        light = 1.0 - DARKNESS * dark[row, column] / 255.0
        for k in range(3):
            colour = (mix * TILES[0, k] + (1.0 - mix) * TILES[1, k]) * light
            image[where[i], k] = colour + floor[i, 2] * (HORIZON[k] - colour)


@njit()
def put_over(image, colour, mask):
    """Downsample a picture by SAMPLES and overlay it on an image where the mask is set.

    Args:
        image: Colours, (height, width, 3).
        colour: Colours, (SAMPLES height, SAMPLES width, 3); black outside of the mask.
        mask: Mask of the picture, (SAMPLES height, SAMPLES width).
    """
    count = SAMPLES * SAMPLES
    for row in range(image.shape[0]):
        for column in range(image.shape[1]):
            cover = 0
            for i in range(SAMPLES * row, SAMPLES * (row + 1)):
                for j in range(SAMPLES * column, SAMPLES * (column + 1)):
                    cover += mask[i, j]
            if not cover:
                continue
            for k in range(3):
                total = 0.0
                for i in range(SAMPLES * row, SAMPLES * (row + 1)):
                    for j in range(SAMPLES * column, SAMPLES * (column + 1)):
                        total += colour[i, j, k]
                image[row, column, k] *= 1.0 - cover / count
                image[row, column, k] += total / count


def look_at(eye: np.ndarray, target: np.ndarray) -> np.ndarray:
    """World to camera, (4, 4): camera at `eye`, -z towards `target`, z of the world up."""
    back = (eye - target) / np.linalg.norm(eye - target)
    right = np.cross([0.0, 0.0, 1.0], back)
    right /= np.linalg.norm(right)
    view = np.eye(4)
    view[:3, :3] = right, np.cross(back, right), back
    view[:3, 3] = -view[:3, :3] @ eye
    return view


def perspective(angle: float, aspect: float, near: float = 0.1, far: float = 100.0) -> np.ndarray:
    """Camera to clip space, (4, 4), OpenGL convention; `angle` is vertical [rad]."""
    f = 1.0 / np.tan(0.5 * angle)
    depth, shift = (far + near) / (near - far), 2.0 * far * near / (near - far)
    return np.array([[f / aspect, 0, 0, 0], [0, f, 0, 0], [0, 0, depth, shift], [0, 0, -1.0, 0]])
