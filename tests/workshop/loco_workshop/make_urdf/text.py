# SPDX-License-Identifier: Apache-2.0
"""Lines of URDF elements, for the generators of URDF files."""

from __future__ import annotations

from math import pi

Vector = tuple[float, float, float]
ZERO: Vector = (0.0, 0.0, 0.0)

# Warm colours for left legs, cool ones for right legs, distinguishable for the colour-blind.
COLOURS = {
    "lf": (0.84, 0.26, 0.08),
    "rf": (0.05, 0.38, 0.68),
    "lh": (0.93, 0.62, 0.10),
    "rh": (0.30, 0.66, 0.88),
}
DARK, METAL, RUBBER = (0.20, 0.22, 0.26), (0.72, 0.74, 0.77), (0.12, 0.12, 0.13)


def link(name: str, mass: float, com: Vector, inertia: tuple, shapes: list[str]) -> list[str]:
    """Lines of a link with mass [kg] and inertia (xx, yy, zz, xy, xz, yz) about `com` [kg·m²]."""
    names = ("ixx", "iyy", "izz", "ixy", "ixz", "iyz")
    tensor = " ".join(f'{n}="{v + 0.0:.9g}"' for n, v in zip(names, inertia, strict=True))
    return [
        f'  <link name="{name}">',
        f'    <inertial><origin xyz="{text(com)}"/><mass value="{mass:g}"/>'
        f"<inertia {tensor}/></inertial>",
        *shapes,
        "  </link>",
    ]


def shape(tag: str, kind: str, size: tuple, xyz: Vector = ZERO, rpy: Vector = ZERO,
           colour: Vector | None = None) -> str:  # fmt: skip
    """A `collision` or `visual` shape: box (sides), cylinder (radius, length) or sphere [m]."""
    sizes = {
        "box": f'size="{text(size)}"',
        "cylinder": f'radius="{size[0]:g}" length="{size[-1]:g}"',
        "sphere": f'radius="{size[0]:g}"',
    }
    paint = ""
    if colour:
        paint = f'<material name="c{"_".join(f"{100 * c:.0f}" for c in colour)}">' \
                f'<color rgba="{text(colour)} 1"/></material>'  # fmt: skip
    return (
        f'    <{tag}><origin xyz="{text(xyz)}" rpy="{text(rpy)}"/>'
        f"<geometry><{kind} {sizes[kind]}/></geometry>{paint}</{tag}>"
    )


def text(values: tuple) -> str:
    """Numbers as an attribute value."""
    return " ".join(f"{v + 0.0:.17g}" if v in (pi, pi / 2, -pi / 2) else f"{v + 0.0:.9g}"
                    for v in values)  # fmt: skip
