# SPDX-License-Identifier: Apache-2.0
"""Write experiments as files: the next one that a gap proposes, or all for a robot."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import yaml

from loco_control.exceptions import MissingFileError, ParameterError
from loco_control.gait.oscillators import CpgParams
from loco_control.params import to_dict
from loco_learning.gap.proposals import pool
from loco_learning.runs.experiment import Experiment
from loco_sim.plant import model as models

from ..outcome import file_at
from . import run as runner
from . import text

HEAD = "# SPDX-License-Identifier: Apache-2.0\n"
KEYS = ("name", "description", "robot", "duration", "overrides", "effects")
ALWAYS = ("kind", "frequency", "amplitude", "offset", "phase", "start_time", "ramp")


def write_next(
    folder: str | Path, rank: int = 1, out: str | Path | None = None
) -> tuple[Path, dict[str, Any]]:
    """Write an experiment proposed by the results of `loco gap`.

    Args:
        folder: Results of `loco gap`.
        rank: Rank of the proposal; 1 is the best.
        out: YAML file, or its folder; by default in `folder`.

    Returns:
        The file, and the row of gap.json.

    Raises:
        LocoError: There is no such result or proposal, or the motion exceeds the robot's limits.
    """
    folder = Path(folder)
    rows = runner.read_json(folder / runner.RESULT, runner.ResultFile)["next"] or []
    if not 1 <= rank <= len(rows):
        raise ParameterError(
            f"{folder} proposes ranks 1 to {len(rows)}, not {rank}"
            if rows
            else f"{folder} proposes no experiment: nothing is left to tell apart"
        )
    row = rows[rank - 1]
    model = models.load_any(runner.load_job(folder).robot)
    selected = pool.choose(pool.pool(model), str(row["experiment"]))
    experiment = pool.within_limits(selected)
    path = file_at(out, folder / f"next_{experiment.name}.yaml")
    return write(experiment, path, f"Proposed by loco gap: {text.next_line(row)}."), row


def write_library(robot: str, folder: str | Path) -> list[Path]:
    """Write every experiment for a robot, each within its limits.

    Raises:
        LocoError: The robot is unknown, or the folder cannot be written.
    """
    out = []
    for experiment in pool.pool(models.load_any(robot)):
        out.append(write(pool.within_limits(experiment), Path(folder) / f"{experiment.name}.yaml"))
    return out


def write(experiment: Experiment, path: Path, comment: str = "") -> Path:
    """Write an experiment as YAML without its default values.

    Raises:
        MissingFileError: The file cannot be written.
    """
    values = {k: v for k, v in to_dict(experiment).items() if k in KEYS and v}
    target, default = to_dict(experiment.target), to_dict(CpgParams())
    values["target"] = {k: v for k, v in target.items() if k in ALWAYS or v != default[k]}
    style = {"sort_keys": False, "default_flow_style": None, "allow_unicode": True}
    body = yaml.safe_dump(runner.plain(values), width=100, **style)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(HEAD + (f"# {comment}\n" if comment else "") + body, encoding="utf-8")
    except OSError as error:
        raise MissingFileError(f"cannot write {path}: {error.strerror}") from None
    return path
