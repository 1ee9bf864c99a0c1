# SPDX-License-Identifier: Apache-2.0
"""Contents of a gap.json and its curves, made up, for tests of what shows them."""

from __future__ import annotations

import base64
import json
import re
import zlib

import numpy as np

from loco_bringup.page.plot import STEPS, UNKNOWN
from loco_learning.gap.localisation.curves import FIT, HELD_OUT, Curve, Curves

TERM = {
    "effect": "coulomb_friction", "place": "pivot", "verdict": "named",
    "parameters": {"torque": {"value": 0.0512, "low": 0.047, "high": 0.056, "unit": "N·m"}},
    "probability": 0.96, "closed": 0.94,
    "look_alikes": ["stribeck_friction"], "evidence": "without it the rms is 14 noise floors.",
}  # fmt: skip
RIVAL = {
    "names": ["stribeck_friction"], "places": ["pivot"], "probability": 0.04, "closed": 0.9,
}  # fmt: skip
NEXT = {
    "experiment": "slow_ramp",
    "separates": ["coulomb_friction", "stribeck_friction"],
    "odds": 120.0,
}


def result(verdict="named", **changes):
    """Contents of a gap.json."""
    named = verdict in ("named", "ambiguous")
    found = {
        "format": 1, "verdict": verdict, "names": ["coulomb_friction"] if named else [],
        "terms": [dict(TERM, verdict=verdict)] if named else [], "rivals": [RIVAL],
        "ambiguous": [["coulomb_friction", "stribeck_friction"]] if verdict == "ambiguous" else [],
        "gap": {"before": 14.2, "after": 1.32 if named else 14.2, "floor": 1.0,
                "closed": 0.94 if named else 0.0, "channels": [],
                "records": [{"name": "steps", "role": "held-out", "before": 14.2, "after": 1.3}]},
        "where": [{"joint": "pivot", "signal": "q", "phase": "all", "band": "0.5-2 Hz",
                   "share": 0.42, "low": 0.36, "high": 0.49}],
        "regions": ["pivot, speed < 0.3 rad/s: 42% of its gap in 12% of the time"], "alarms": [],
        "identifiability": {"worst": "torque up with stiffness up", "dead": [],
                            "cosines": [{"a": "torque", "b": "damping", "cosine": 0.81}]},
        "next": [NEXT], "correction": None, "align": ["q is quantised in steps of 0.00506"],
        "notes": ["the experiment slow_ramp is not possible: too fast"],
        "not_tried": [{"effect": "slip", "reason": "random"}],
        "nuisance": {"clock_offset": 0.004}, "settings": {"seed": 0, "window": 0.0},
        "pieces": 0.0, "compared": "motion",
        "model": {"robot": "servo_pendulum", "overrides": {},
                  "effects": [{"name": "coulomb_friction", "joint": "pivot", "torque": 0.0512}]
                  if named else []},
    }  # fmt: skip
    return {**found, **changes}


def shown(page):
    """Values of each plot of a page by its title: a list of lines of each panel by its label."""
    found = {}
    for text in re.findall(r'<script type="application/json">(.*?)</script>', page, re.S):
        data = json.loads(text)
        if "count" not in data:
            continue
        packed = zlib.decompress(base64.b64decode(data["steps"]))
        rows = np.frombuffer(packed, "<i2").reshape(-1, data["count"])
        panels, at = {}, 0
        for panel in data["panels"]:
            panels[panel["label"]] = [
                _unpacked(row, line["ends"], panel["log"])
                for row, line in zip(rows[at:], panel["lines"], strict=False)
            ]
            at += len(panel["lines"])
        found[data["title"]] = panels
    return found


def _unpacked(differences, ends, logarithmic):
    steps = np.cumsum(differences, dtype=np.int16)
    values = ends[0] + (steps.astype(float) + STEPS // 2) * (ends[1] - ends[0]) / STEPS
    known = steps != UNKNOWN
    return np.where(known, 10.0**values if logarithmic else values, np.nan)


def curves():
    """Two records of one channel."""
    t = np.arange(400) / 100.0
    made = [
        Curve(name, role, t, *(np.sin(3.0 * t - lag)[:, None] for lag in (0.0, 0.2, 0.02)),
              np.full((400, 1), 0.005), np.full(400, role == HELD_OUT), np.zeros(0))
        for name, role in (("chirp", FIT), ("steps", HELD_OUT))
    ]  # fmt: skip
    return Curves((("q", "pivot", "rad"),), tuple(made))
