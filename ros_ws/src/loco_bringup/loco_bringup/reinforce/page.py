# SPDX-License-Identifier: Apache-2.0
"""Self-contained HTML page about the reinforcement learning of a readout."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from markupsafe import Markup

from loco_control.files import write_whole
from loco_control.params import to_dict
from loco_learning.drawing.chart import PALETTE
from loco_learning.reinforce.learn import Learnt
from loco_learning.reinforce.params import ReinforceParams
from loco_learning.reinforce.trials import Row
from loco_learning.runs.experiment import Experiment

from ..page import html
from ..page.plot import Line, Panel, Plot

NAME = "reinforce.html"
CURVE = (
    "Unperturbed readout before each update, over the simulated time spent; the last value is that "
    "of the readout after the last update. Thin: mean return of the perturbed readouts of the "
    "update, and the share of them that fell."
)
TRIALS = (
    "Forward speed while the readout drives; after a fall no way is made. Pushed: random forces on "
    "the base. Bodies: stiffness, friction and masses drawn around the nominal ones."
)
HEAD = ("Readout", "Trials", "Speed [m/s]", "Cost of transport", "Falls")


def write(
    experiment: Experiment,
    params: ReinforceParams,
    learnt: Learnt,
    trials: dict[str, dict[str, Row]],
    folder: Path,
) -> Path:
    """Write the page; returns its path. After an error no incomplete file remains."""
    header = html.join(
        [
            html.paragraph(
                f"The readout of {experiment.name} improved by the policy gradient of thesis "
                "section 3.4.3: perturbed, paid for speed, charged for power and falls.",
                soft=True,
            ),
            html.cards(
                [
                    ("Return before", html.number(learnt.first), ""),
                    ("Return after", html.number(learnt.value), f"after update {learnt.update}"),
                    ("Simulated time", f"{learnt.seconds:.0f}", "s"),
                ]
            ),
        ]
    )
    sections = [
        html.part("Learning", lambda: html.figure(curve(learnt), "Learning", CURVE)),
        html.part("Trials", lambda: _trials(trials)),
        html.part("Settings", lambda: html.yaml_block(to_dict(params)), long=True),
    ]
    text = html.document(f"{experiment.name}, reinforced", header, sections)
    return write_whole(folder / NAME, text)


def curve(learnt: Learnt) -> Plot:
    """Return, speed, cost of transport and falls over the simulated time."""
    c, blue, red = learnt.course, PALETTE[0], PALETTE[1]
    panels = [
        Panel(
            "return [-]",
            [
                Line("readout", c["value"], blue, 2.0),
                Line("perturbed, mean", c["batch"], red, 0.8),
            ],
        ),
        Panel("speed [m/s]", [Line("speed", c["speed"], blue, 2.0)]),
        Panel("cost of transport [-]", [Line("cost of transport", c["cost"], blue, 2.0)]),
        Panel("perturbed that fell [-]", [Line("share of falls", c["falls"], red, 0.8)]),
    ]
    return Plot(np.asarray(c["seconds"]), panels, axis="simulated time [s]")


def _trials(trials: dict[str, dict[str, Row]]) -> Markup:
    if not trials:
        return html.missing("No trials were asked for (--trials 0).")
    rows = [
        [name, condition, html.number(row.speed), html.number(row.cost), f"{row.falls}/{row.count}"]
        for name, each in trials.items()
        for condition, row in each.items()
    ]
    return html.paragraph(TRIALS, soft=True) + html.table(HEAD, rows, range(2, len(HEAD)))
