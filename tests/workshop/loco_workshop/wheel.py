# SPDX-License-Identifier: Apache-2.0
"""Build the wheel and try it in fresh environments: a table and a URDF alone get their page.

    PYTHONPATH=tests/workshop .venv/bin/python -m loco_workshop.wheel python3.10 python3.13

Exit code 1: in one of the environments there was no page, or it took too long.
"""

from __future__ import annotations

import gzip
import itertools
import json
import os
import resource
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from loco_bringup.terminal import console

ROOT = Path(__file__).resolve().parents[3]
SOURCES = ("pyproject.toml", "README.md", "LICENSE", "NOTICE", "requirements", "src",
           "ros_ws/src/loco_bringup")  # fmt: skip
MADE = shutil.ignore_patterns("*.egg-info", "__pycache__", "build")
MOST = (
    60.0  # processor time of the search with the first compilation [s]; issue of the first minute
)
# The recording and the URDF of docs/tutorial_log.md.
DATA = ROOT / "bags/measured/dfki_pendulum"
LOG, URDF = "control_method_energy_shaping_data_measured_1kg.csv.gz", "dfki_pendulum.urdf"


def build(folder: Path) -> Path:
    """Wheel of the working tree, made in a copy in which nothing old lies; returns its path."""
    for name in SOURCES:
        source, target = ROOT / name, folder / "tree" / name
        target.parent.mkdir(parents=True, exist_ok=True)
        if source.is_dir():
            shutil.copytree(source, target, ignore=MADE)
        else:
            shutil.copy(source, target)
    pip = [sys.executable, "-m", "pip", "wheel", "-q", "--no-deps", "--no-build-isolation"]
    subprocess.run([*pip, "-w", folder, folder / "tree"], check=True)
    return next(folder.glob("loco_gap-*.whl"))


def search(loco: Path, folder: Path, *more: str, rows: int = 10**6) -> tuple[dict, float]:
    """Result of `loco gap my.csv --robot my.urdf` in a folder, and its processor time [s].

    Args:
        loco: The command.
        folder: New folder.
        more: Further arguments of the command.
        rows: Number of rows of the recording that are used, from the first on.
    """
    folder.mkdir()
    with gzip.open(DATA / LOG, "rt", encoding="utf-8") as file:
        (folder / "my.csv").write_text("".join(itertools.islice(file, rows + 1)), encoding="utf-8")
    shutil.copy(DATA / URDF, folder / "my.urdf")
    before = _processor_time()
    words = [loco, "gap", "my.csv", "--robot", "my.urdf", "--out", "results", *more]
    names = ("PATH", "HOME", "TMPDIR", "NUMBA_CACHE_DIR")  # nothing of this process's packages
    kept = {name: os.environ[name] for name in names if name in os.environ}
    kept |= {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    subprocess.run(words, cwd=folder, env=kept, check=True)
    page = (folder / "results/gap.html").read_text(encoding="utf-8")
    assert page.startswith("<!DOCTYPE html>") and "</html>" in page
    return json.loads((folder / "results/gap.json").read_text()), _processor_time() - before


def _processor_time() -> float:
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def main(pythons: list[str]) -> int:
    """Try the wheel with each interpreter; prints a row of each, returns the exit code."""
    well = True
    with tempfile.TemporaryDirectory() as place:
        wheel = build(Path(place))
        console.print(f"{wheel.name}, {wheel.stat().st_size / 1e6:.1f} MB")
        console.print("| Python | install [s] | processor time of the search [s] | verdict |")
        for number, python in enumerate(pythons):
            environment, start = Path(place, f"environment_{number}"), time.monotonic()
            subprocess.run([python, "-m", "venv", environment], check=True)
            own = environment / "bin/python"
            subprocess.run([own, "-m", "pip", "install", "-q", wheel], check=True)
            installed = time.monotonic() - start
            version = [own, "-c", "import platform; print(platform.python_version())"]
            name = subprocess.run(
                version, capture_output=True, text=True, check=True
            ).stdout.strip()
            result, seconds = search(environment / "bin/loco", Path(place, f"search_{number}"))
            row = (name, f"{installed:.0f}", f"{seconds:.0f}", result["verdict"])
            console.print(f"| {' | '.join(row)} |")
            well = well and seconds <= MOST
            shutil.rmtree(environment)
    return int(not well)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:] or [sys.executable]))
