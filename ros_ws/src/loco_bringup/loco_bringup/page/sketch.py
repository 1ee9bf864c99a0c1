# SPDX-License-Identifier: Apache-2.0
"""Line drawing of a robot in its standing pose, with selected links marked."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree
from collections.abc import Collection, Sequence
from fnmatch import fnmatchcase

import numpy as np
from markupsafe import Markup

from loco_sim.robot.frames import link_frames
from loco_sim.robot.robot import Robot

# View from the right, slightly from above: forward points right, the left side lies behind.
VIEW = np.array([[1.0, 0.3, 0.0], [0.0, -0.22, -1.0]])
WIDTH, HEIGHT, MARGIN = 360.0, 230.0, 26.0  # size and margin of the drawing [pixel]


def marked(robot: Robot, names: Sequence[str]) -> set[str]:
    """Links at the given places: named links, and links moved by named joints.

    Args:
        robot: The robot.
        names: Names of links, joints or feet; ``*`` and ``[lr]`` are wildcards.
    """
    links_marked = set()
    for joint, _, child in _joints(robot):
        links_marked |= {child for place in names if fnmatchcase(joint, place)}
    links = {link for _, *pair in _joints(robot) for link in pair}
    return links_marked | {link for link in links for place in names if fnmatchcase(link, place)}


def drawing(robot: Robot, links: Collection[str], where: str) -> Markup:
    """Drawing of a robot as SVG.

    Args:
        robot: The robot, in its standing pose.
        links: Links whose joint is marked.
        where: Description of the marked places.
    """
    frames = link_frames(robot, np.asarray(robot.standing, dtype=float)[None])
    points = {link: VIEW @ origin[0] for link, (_, origin) in frames.items()}
    bones = [(parent, child) for _, parent, child in _joints(robot)]
    for link, centre in _last(robot).items():
        rotation, origin = frames[link]
        points[f"{link} centre"] = VIEW @ (origin[0] + rotation[0] @ centre)
        bones.append((link, f"{link} centre"))
    positions = np.array(list(points.values()))
    low, size = positions.min(axis=0), np.ptp(positions, axis=0)
    extent = np.array([WIDTH - 2 * MARGIN, HEIGHT - 2 * MARGIN])
    scale = float(np.min(extent / np.maximum(size, 1e-3 + 0.02 * size.max())))
    start = (np.array([WIDTH, HEIGHT]) - scale * size) / 2.0
    at = {link: start + scale * (point - low) for link, point in points.items()}
    lines = [
        Markup('<line x1="{:.1f}" y1="{:.1f}" x2="{:.1f}" y2="{:.1f}"/>').format(*at[a], *at[b])
        for a, b in bones
    ]
    dots = [Markup('<circle cx="{:.1f}" cy="{:.1f}" r="3"/>').format(*p) for p in at.values()]
    rings = [
        Markup('<circle class="here" cx="{:.1f}" cy="{:.1f}" r="10"/>').format(*at[link])
        for link in sorted(links)
    ]
    title = f"The robot as it stands, from its right side; marked: {where}"
    frame = Markup('<svg class="robot" viewBox="0 0 {:g} {:g}" role="img" aria-label="{}">{}</svg>')
    return frame.format(WIDTH, HEIGHT, title, Markup("").join([*lines, *dots, *rings]))


def _last(robot: Robot) -> dict[str, np.ndarray]:
    """Centre of mass [m] of each link that carries no other, (3,): it shows where the link is."""
    carrying = {parent for _, parent, _ in _joints(robot)}
    centres = {
        link.get("name"): np.array(origin.get("xyz", "0 0 0").split(), dtype=float)
        for link in ElementTree.fromstring(robot.urdf).findall("link")
        if (origin := link.find("inertial/origin")) is not None
    }
    return {link: xyz for link, xyz in centres.items() if link not in carrying and xyz.any()}


def _joints(robot: Robot) -> list[tuple[str, str, str]]:
    """Name, parent and child of each joint."""
    joints = ElementTree.fromstring(robot.urdf).findall("joint")
    return [(j.get("name"), *(j.find(k).get("link") for k in ("parent", "child"))) for j in joints]
