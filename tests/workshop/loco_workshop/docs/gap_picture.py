# SPDX-License-Identifier: Apache-2.0
"""Picture of the first page: prediction of a held-out stretch before and after the search.

Run with the result of the third search of ``docs/tutorial_log.md``:
``PYTHONPATH=tests/workshop .venv/bin/python -m loco_workshop.docs.gap_picture results/arm_known``
"""

from __future__ import annotations

import argparse
import json
from pathlib import Path

import matplotlib

matplotlib.use("Agg")
import matplotlib.pyplot as plt
import numpy as np

TARGET = Path("docs/pictures/gap.png")
COLOURS = {"before": "#c2410c", "after": "#1d4ed8"}
JUMP = 10.0  # change of the error where a piece begins, over its usual change


def draw(folder: Path, target: Path = TARGET) -> None:
    """Draw the angle of the first joint in the judged rows of the first record of a search.

    Args:
        folder: Folder with ``gap.json`` and ``gap.npz``.
        target: PNG to write.
    """
    found = json.loads((folder / "gap.json").read_text())["gap"]
    data = np.load(folder / "gap.npz")
    rows = np.flatnonzero(data["judged_0"])
    t, measured = data["t_0"][rows], data["measured_0"][rows, 0]
    titles = {
        "before": f"The model as it was: {found['before']:.0f} noise floors off",
        "after": f"With the payload that loco names: {found['after']:.1f} noise floors",
    }
    figure, axes = plt.subplots(1, 2, figsize=(11, 3.8), sharey=True)
    for axis, (which, title) in zip(axes, titles.items(), strict=True):
        model = data[f"{which}_0"][rows, 0]
        change = np.abs(np.diff(model - measured))
        starts = np.append(change > JUMP * np.median(change), False)  # the measured state again
        axis.plot(t, measured, color="#9ca3af", lw=6, label="measured")
        axis.plot(t, np.where(starts, np.nan, model), color=COLOURS[which], lw=1.8, label="model")
        axis.set(title=title, xlabel="time [s]")
        axis.legend(frameon=False, loc="lower left")
        axis.spines[["top", "right"]].set_visible(False)
    axes[0].set_ylabel("angle of the pendulum [rad]")
    figure.tight_layout()
    figure.savefig(target, dpi=100)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path, help="result of loco gap")
    draw(parser.parse_args().folder)
