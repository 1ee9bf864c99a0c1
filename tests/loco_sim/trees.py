# SPDX-License-Identifier: Apache-2.0
"""Trees of links that nobody built, as URDF text."""

from __future__ import annotations

import numpy as np

LINK = """<link name="{name}"><inertial><origin xyz="{com}" rpy="{turn}"/><mass value="{mass}"/>
<inertia ixx="{x}" iyy="{y}" izz="{z}" ixy="0" ixz="0" iyz="0"/></inertial></link>"""
JOINT = """<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>
<origin xyz="{place}" rpy="{turn}"/><axis xyz="{axis}"/>
<limit lower="-3" upper="3" effort="100" velocity="100"/></joint>"""


def words(values: np.ndarray) -> str:
    return " ".join(f"{v:.9g}" for v in values)


def random_urdf(seed: int, count: int = 6) -> tuple[str, tuple[str, ...]]:
    """Links of any mass at any place; every third joint is fixed, one slides, some branch off.

    Returns:
        The URDF, and the joints that move.
    """
    rng = np.random.default_rng(seed)
    parts, moving = [], []
    for k in range(count + 1):
        mass = rng.uniform(0.2, 3.0)
        # Moments of a cloud of points, whose sums obey the inequality of the triangle.
        a, b, c = mass * rng.uniform(0.01, 0.1, 3) ** 2
        about = {"x": b + c, "y": a + c, "z": a + b}
        com, turn = rng.uniform(-0.1, 0.1, 3), rng.uniform(-3.0, 3.0, 3)
        turn *= k > 0  # PyBullet turns a bolted robot with the inertia of its base
        link = {"name": f"link_{k}", "mass": f"{mass:.9g}", "com": words(com), "turn": words(turn)}
        parts.append(LINK.format(**link, **{key: f"{v:.9g}" for key, v in about.items()}))
        if k:
            kind = "fixed" if k % 3 == 0 else "prismatic" if k == 2 else "revolute"
            joint = {"name": f"joint_{k}", "kind": kind, "child": f"link_{k}"}
            joint["parent"] = f"link_{rng.integers(max(0, k - 2), k)}"
            axis = rng.uniform(-1.0, 1.0, 3)
            joint["axis"] = words(axis / np.linalg.norm(axis))
            place, turn = rng.uniform(-0.3, 0.3, 3), rng.uniform(-3.0, 3.0, 3)
            parts.append(JOINT.format(**joint, place=words(place), turn=words(turn)))
            moving += [joint["name"]] if kind != "fixed" else []
    return f'<robot name="random">{"".join(parts)}</robot>', tuple(moving)
