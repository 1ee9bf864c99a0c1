# SPDX-License-Identifier: Apache-2.0
"""Camera, checkered floor, sky and soft shadow around a robot, in NumPy.

The engine's software renderer draws the robot only: it has no usable shadow, and
its time goes with the number of pixels, so it gets no more than the robot needs.
"""

from __future__ import annotations

import numpy as np
from PIL import Image, ImageFilter

from .world import World

EYE = np.array([1.15, -2.05, 0.55])  # from the point looked at to the camera [m]
FIELD_OF_VIEW = np.radians(34.0)  # vertical
LIGHT = np.array([0.35, -0.55, 1.0]) / np.linalg.norm([0.35, -0.55, 1.0])  # towards the light
SUN = 20.0  # distance of the light [m]
SHADOW_PIXELS, SHADOW_SPAN, DARKNESS = 288, 2.4, 0.45  # [pixel], [m], [-]
TILE = 0.25  # [m]
TILES = np.array([[0.93, 0.94, 0.95], [0.80, 0.82, 0.85]])
SKY, HORIZON = np.array([0.78, 0.86, 0.94]), np.array([0.97, 0.98, 0.99])
FOG = 5.0  # distance over which the floor fades into the horizon [m]
SAMPLES = 2  # the robot is drawn this much larger and then reduced


class Stage:
    """A camera that keeps its direction and moves with the robot.

    What does not change from picture to picture is worked out once.

    Args:
        size: Width and height of the pictures [pixel].
        height: Height of the point looked at [m], of a robot of full size.
        scale: Size of the robot; all lengths above are for a robot of about a metre.
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
        self._fog = 1.0 - np.exp(-((reach / (FOG * scale)) ** 2))[:, None]
        # Width of a pixel on the ground, in tiles, along the ray and across it.
        across = 2.0 * np.tan(0.5 * FIELD_OF_VIEW) / high * reach / self._tile
        self._blur = (across * np.sqrt(1.0 + (reach / (height + self._eye[2])) ** 2))[:, None]

    def _rays(self) -> np.ndarray:
        """Direction of each pixel in the world, not normalised, (height, width, 3)."""
        wide, high = self.size
        x = (2.0 * np.arange(wide) + 1.0) / wide - 1.0
        y = 1.0 - (2.0 * np.arange(high) + 1.0) / high
        u, v = np.meshgrid(x / self._projection[0, 0], y / self._projection[1, 1])
        turn = look_at(EYE, np.zeros(3))[:3, :3]
        return np.stack([u, v, -np.ones_like(u)], axis=-1) @ turn

    def draw(self, world: World, centre: np.ndarray) -> Image.Image:
        """Picture of the world as it stands, looking at a point over or under `centre` [m]."""
        target = np.array([centre[0], centre[1], self._height])
        image = self._sky.copy()
        image[self._down] = self._floor(world, target)
        self._paint(image, world, look_at(target + self._eye, target))
        return Image.fromarray((255.0 * image.clip(0.0, 1.0)).astype(np.uint8))

    def _floor(self, world: World, target: np.ndarray) -> np.ndarray:
        ground = self._ground + target[:2]
        wave = (
            2.0 * np.abs((ground / self._tile) % 2.0 - 1.0) - 1.0
        )  # triangle, one period two tiles
        square = (wave / self._blur.clip(1e-3)).clip(-1.0, 1.0)  # smooth over a pixel
        mix = 0.5 + 0.5 * square[:, :1] * square[:, 1:]
        colour = mix * TILES[0] + (1.0 - mix) * TILES[1]
        colour *= 1.0 - DARKNESS * self._shadow(world, target, ground)[:, None]
        return colour + self._fog * (HORIZON - colour)

    def _shadow(self, world: World, target: np.ndarray, ground: np.ndarray) -> np.ndarray:
        """How dark each point of the ground is, in [0, 1]: a blurred silhouette from the light."""
        sun = SUN * self._scale
        view = look_at(target + sun * LIGHT, target)
        angle = 2.0 * np.arctan(0.5 * SHADOW_SPAN / SUN)
        camera = perspective(angle, 1.0, self._scale, 2.0 * sun)
        _, robot = world.picture(view, camera, (SHADOW_PIXELS, SHADOW_PIXELS), tuple(LIGHT))
        silhouette = Image.fromarray((255 * robot).astype(np.uint8))
        blurred = np.asarray(silhouette.filter(ImageFilter.GaussianBlur(2.2))) / 255.0
        clip = np.column_stack([ground, np.zeros(len(ground)), np.ones(len(ground))])
        clip = clip @ (camera @ view)[[0, 1, 3]].T
        place = clip[:, :2] / clip[:, 2:] * [0.5, -0.5] + 0.5
        column, row = (place * SHADOW_PIXELS).astype(int).clip(0, SHADOW_PIXELS - 1).T
        return blurred[row, column]  # the border of the silhouette is empty

    def _paint(self, image: np.ndarray, world: World, view: np.ndarray) -> None:
        """Draw the robot over the image, in the part of it where it is."""
        left, top, right, bottom = self._box(world.corners(0.08 * self._scale), view)
        if right <= left or bottom <= top:
            return
        wide, high = self.size
        zoom = np.diag([wide / (right - left), high / (bottom - top), 1.0, 1.0])
        zoom[0, 3] = (wide - left - right) / (right - left)
        zoom[1, 3] = (top + bottom - high) / (bottom - top)
        shape = (SAMPLES * (right - left), SAMPLES * (bottom - top))
        colour, robot = world.picture(view, zoom @ self._projection, shape, tuple(LIGHT))
        cover = robot[..., None].astype(float)
        part = image[top:bottom, left:right]
        part *= 1.0 - _reduced(cover)
        part += _reduced(colour * cover)

    def _box(self, points: np.ndarray, view: np.ndarray) -> tuple[int, int, int, int]:
        """Pixels around some points: left, top, right, bottom."""
        wide, high = self.size
        clip = np.column_stack([points, np.ones(len(points))]) @ (self._projection @ view).T
        x = (0.5 + 0.5 * clip[:, 0] / clip[:, 3]) * wide
        y = (0.5 - 0.5 * clip[:, 1] / clip[:, 3]) * high
        left, right = np.clip([np.floor(x.min()), np.ceil(x.max())], 0, wide).astype(int)
        top, bottom = np.clip([np.floor(y.min()), np.ceil(y.max())], 0, high).astype(int)
        return int(left), int(top), int(right), int(bottom)


def _reduced(image: np.ndarray) -> np.ndarray:
    """Mean over blocks of SAMPLES x SAMPLES pixels."""
    high, wide, depth = image.shape
    blocks = image.reshape(high // SAMPLES, SAMPLES, wide // SAMPLES, SAMPLES, depth)
    return blocks.mean(axis=(1, 3))


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
