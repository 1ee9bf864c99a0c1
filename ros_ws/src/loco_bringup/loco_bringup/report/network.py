# SPDX-License-Identifier: Apache-2.0
"""Report page of a mass-spring-damper network that ran as a graph."""

from __future__ import annotations

import io
import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import reduce
from pathlib import Path

import numpy as np
from markupsafe import Markup
from PIL import Image, ImageDraw

from loco_control.exceptions import BagError
from loco_control.ros.messages.joint_codec import JointCodec
from loco_control.ros.messages.msd_topics import link_names, node_names
from loco_learning.drawing.chart import Axis, Chart, Frame
from loco_learning.drawing.chart import line as draw_line
from loco_learning.params import PHASES
from loco_learning.runs.experiment import from_values, is_network
from loco_learning.runs.network_experiment import NetworkExperiment
from loco_sim.msd.network import Network, chain

from ..bag.reader import Bag
from ..page import html
from ..page.html import document, part
from ..page.plot import Line, Panel, Plot, Span
from ..page.style import BROAD, COMMAND, OTHER, TARGET, TINTS, Chapter
from . import parts

DURATION = 6.0  # length of the animation [s]
MIN_ERROR = 1e-6  # lower bound of drawn errors
SKY, SOIL, MASS = (255, 255, 255), (222, 214, 202), (34, 34, 34)
SHORT, LONG = np.array([213, 94, 0]), np.array([0, 114, 178])  # colours of links


@dataclass(frozen=True)
class MsdLog:
    """A recorded run, one row per tick."""

    experiment: NetworkExperiment
    network: Network
    t: np.ndarray  # [s], (T,)
    position: np.ndarray  # node positions [m], (T, nodes, axes)
    acceleration: np.ndarray  # [m/s²]
    command: np.ndarray  # commanded over rest lengths, (T, links)
    prediction: np.ndarray  # output of the readout
    target: np.ndarray  # output of the open loop

    @property
    def dt(self) -> float:
        """Period of a tick [s]."""
        return self.experiment.dt

    @property
    def distance(self) -> np.ndarray:
        """Distance of the centre of mass along x [m], (T,)."""
        x = self.network.centre_of_mass(self.position)[:, 0]
        return x - x[0]

    def spans(self) -> list[tuple[str, float, float]]:
        """Name, start and end [s] of the recorded phases."""
        loop, start, out = self.experiment.loop, 0.0, []
        for name in PHASES[1:]:
            end = start + getattr(loop, name)
            if start < self.t[-1]:
                out.append((name, start, float(min(end, self.t[-1]))))
            start = end
        return out


def is_msd(bag: Bag) -> bool:
    """Whether the bag is a run of a mass-spring network."""
    if "experiment.yaml" not in bag.attachments():
        return False
    values = bag.yaml("experiment.yaml")
    return isinstance(values, dict) and is_network(values)


def read_msd_log(bag: Bag) -> MsdLog:
    """Log at the ticks at which all topics have the same stamp.

    Raises:
        BagError: The topics have no stamp in common.
    """
    experiment = from_values(bag.yaml("experiment.yaml"))
    network = chain(experiment.network)
    nodes = node_names(network.nodes, network.dimension)
    links = link_names(network.links.tolist())
    states = _read(bag, "node_states", JointCodec(nodes))
    sent = [
        _read(bag, f"link_{name}", JointCodec(links, name, ("position",)))
        for name in ("command", "prediction", "target")
    ]
    stamps = reduce(np.intersect1d, [part[0] for part in (states, *sent)])
    if not len(stamps):
        raise BagError(f"{bag.path}: node_states and link_command have no stamp in common")
    at = [np.searchsorted(part[0], stamps) for part in (states, *sent)]
    shape = (len(stamps), network.dimension, network.nodes)
    position, acceleration = (np.swapaxes(states[k][at[0]].reshape(shape), 1, 2) for k in (1, 3))
    columns = [part[1][rows] for part, rows in zip(sent, at[1:], strict=True)]
    return MsdLog(experiment, network, stamps / 1e9, position, acceleration, *columns)


def _read(bag: Bag, topic: str, codec: JointCodec) -> tuple[np.ndarray, ...]:
    rows = [codec.read(data) for data in bag.raw(topic)[1]]
    if not rows:
        raise BagError(f"{bag.path} has no messages on {topic}")
    time, first = np.unique(np.array([row.time for row in rows]), return_index=True)
    return (time, *(np.array([row[k] for row in rows])[first] for k in (1, 2, 3)))


# ---- the page


def page(bag: Bag, log: MsdLog, gif: Path | None) -> str:
    """HTML text of a report; `gif` is the path of the animation, None for no animation."""
    figures: Sequence[tuple] = (
        ("Distance", "Centre of mass along x, and the driven lengths it costs.", distance_figure),
        ("Learning", "Error of the readout against the open loop, rms over links.", error_figure),
        ("Links", "Driven lengths of three links at the end of the run.", links_figure),
        ("Limit cycle", "Accelerations of the test in two principal components.", cycle_figure),
    )
    moving = part("Animation", lambda: animation(log, gif)).content
    return document(
        log.experiment.name,
        html.paragraph(log.experiment.description, soft=True)
        + html.beside(html.paragraph(sentence(log)), moving),
        [
            *parts.drawn([Chapter(*figure) for figure in figures], log),
            part("Facts", lambda: facts(bag, log)),
            part("Configuration", lambda: parts.configuration(log.experiment), long=True),
            part("Messages", lambda: parts.message_table(bag)),
        ],
    )


def facts(bag: Bag, log: MsdLog) -> Markup:
    """Table of phases, seed, clock, versions and drops."""
    names = " · ".join(f"{name} {a:g}–{b:.4g} s" for name, a, b in log.spans())
    return html.facts({"Phases": names, **parts.run_facts(bag, log.experiment.seed, "msd")})


def sentence(log: MsdLog) -> str:
    """Summary of the run as a sentence."""
    speed = {name: _speed(log, a, b) for name, a, b in log.spans() if b - a > 0.5}
    speeds = ", ".join(f"{value:.2f} m/s in {name}" for name, value in speed.items())
    text = f"{log.network.nodes} masses and {log.network.count} springs went "
    text += f"{log.distance[-1]:.1f} m in {log.t[-1]:.1f} s: {speeds}."
    if "test" in speed:
        text += " In test nothing but the readout of their accelerations drove the springs."
    return text


def _speed(log: MsdLog, start: float, end: float) -> float:
    a, b = np.interp([start, end], log.t, log.distance)
    return float((b - a) / (end - start))


def _tinted(log: MsdLog) -> list[Span]:
    return [(TINTS[name], name, a, b) for name, a, b in log.spans()]


def distance_figure(log: MsdLog) -> Plot:
    """Distance over time."""
    panel = Panel("distance [m]", [Line("centre of mass", log.distance, OTHER)])
    return Plot(log.t, [panel], _tinted(log))


def error_figure(log: MsdLog) -> Plot:
    """Error of the readout over time."""
    error = np.sqrt(np.mean((log.prediction - log.target) ** 2, axis=1))
    line = Line("error", np.maximum(error, MIN_ERROR), OTHER)
    return Plot(log.t, [Panel("error [-]", [line], logarithmic=True)], _tinted(log))


def links_figure(log: MsdLog) -> Plot:
    """Target and command of the three links with the largest amplitudes."""
    names = link_names(log.network.links.tolist())
    panels = [
        Panel(
            f"{names[link].replace('_', ' ')} [of its rest length]",
            [
                Line("open loop", log.target[:, link], TARGET, BROAD),
                Line("driven", log.command[:, link], COMMAND),
            ],
        )
        for link in np.argsort(-np.ptp(log.target, axis=0))[:3]
    ]
    return Plot(log.t, panels, _tinted(log), view=(max(log.t[0], log.t[-1] - 3.0), log.t[-1]))


def cycle_figure(log: MsdLog) -> Chart:
    """Accelerations, smoothed over 0.1 s, in their principal components."""
    start = next((a for name, a, _ in log.spans() if name == "test"), log.t[-1] / 2.0)
    a = log.acceleration[log.t >= start].reshape(np.count_nonzero(log.t >= start), -1)
    width = max(1, round(0.1 / log.dt))
    if len(a) < 2 * width:
        raise BagError("the test is too short for a limit cycle")
    total = np.cumsum(a, axis=0)
    smooth = (total[width:] - total[:-width]) / width
    smooth = smooth - smooth.mean(axis=0)
    path = smooth @ np.linalg.svd(smooth, full_matrices=False)[2][:2].T
    path = path[:: max(1, len(path) // 3000)]
    axes = (Axis(f"{rank} component [m/s²]") for rank in ("1st", "2nd"))
    layers = [draw_line("test", *path.T, OTHER, size=0.6)]
    return Chart([Frame(*axes, layers, height=360)])


# ---- the animation


def animation(log: MsdLog, path: Path | None) -> Markup:
    """GIF of the end of the run, written to `path` and embedded in the page."""
    if path is None:
        raise BagError("the animation was left out on request")
    start = max(0.0, float(log.t[-1]) - DURATION)
    data = render(log, start)
    path.write_bytes(data)
    text = f"The network at the end of the run, from {start:.1f} s to "
    text += f"{log.t[-1]:.1f} s, in real time. Links driven short are orange, driven long blue."
    return html.movie(data, text, start, float(log.t[-1]))


def render(log: MsdLog, start: float, fps: float = parts.FPS) -> bytes:
    """GIF of a run from `start` [s]; the view follows the centre of mass."""
    stride = max(1, round(1.0 / (fps * log.dt)))
    rows = np.flatnonzero(log.t >= start)[::stride]
    width, height = parts.SIZE
    span = np.ptp(log.position[rows, :, 0] - log.position[rows, :, 0].mean(axis=1)[:, None])
    top = log.position[rows, :, -1].max()
    scale = min(width / (1.15 * span), (height - 40) / (1.1 * max(top, 1.0)))
    frames = [_frame(log, row, scale, width, height) for row in rows]
    file = io.BytesIO()
    frames[0].save(
        file, "GIF", save_all=True, append_images=frames[1:], loop=0,
        duration=round(1000.0 * stride * log.dt),
    )  # fmt: skip
    return file.getvalue()


def _frame(log: MsdLog, row: int, scale: float, width: int, height: int) -> Image.Image:
    picture = Image.new("RGB", (width, height), SKY)
    draw = ImageDraw.Draw(picture)
    ground = height - 30
    draw.rectangle((0, ground, width, height), fill=SOIL)
    middle = float(log.position[row, :, 0].mean())
    x = width / 2 + scale * (log.position[row, :, 0] - middle)
    z = ground - scale * log.position[row, :, -1]
    half_width = width / 2 / scale
    for metre in range(math.ceil(middle - half_width), math.floor(middle + half_width) + 1):
        at = width / 2 + scale * (metre - middle)
        draw.line((at, ground, at, ground + (12 if metre % 5 == 0 else 6)), fill=(150, 140, 120))
    for (i, j), factor in zip(log.network.links, log.command[row], strict=True):
        share = float(np.clip((factor - 0.75) / 0.5, 0.0, 1.0))
        colour = tuple(int(v) for v in (1.0 - share) * SHORT + share * LONG)
        draw.line((x[i], z[i], x[j], z[j]), fill=colour, width=1)
    for a, b in zip(x, z, strict=True):
        draw.ellipse((a - 3, b - 3, a + 3, b + 3), fill=MASS)
    draw.text((8, 6), f"{log.t[row]:.1f} s   {log.distance[row]:.1f} m", fill=MASS)
    return picture.quantize(64)
