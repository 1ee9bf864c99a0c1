# SPDX-License-Identifier: Apache-2.0
"""The `loco` command. Heavy imports live in the functions, so that ``--help`` is instant."""

from __future__ import annotations

import argparse
import functools
import logging
import os
import subprocess
import sys
from pathlib import Path

from loco_control.exceptions import LocoError

from . import __version__, cli_run, cli_watch

EPILOG = """\
exit codes: 0 done, 1 a run failed (node died, not ready), 2 a mistake in the input,
            3 the robot fell, 130 interrupted
examples:
  loco demo                                  run, record, report: the whole chain
  loco list                                  experiments, studies, effects, bags
  loco run hyq_trot_reflex                   composed, lockstep, as fast as it goes
  loco run hyq_trot_open --layout processes --clock realtime
  loco run my_experiment.yaml --seed 3 --set gait.speed=0.3
  loco report bags/hyq_trot_reflex_...       one HTML page with figures and a GIF
"""

# `loco test` alone: everything, two at a time, with coverage of the nodes' processes too.
ALL_TESTS = ["-q", "-n", "2", "--dist", "loadgroup", "--cov", "--cov-report=term:skip-covered",
             "--cov-fail-under=90"]  # fmt: skip


def main(argv: list[str] | None = None) -> None:
    """Entry point: parse, run the command, turn errors into one line."""
    logging.basicConfig(level=logging.WARNING, format="loco: %(message)s")
    os.environ.setdefault("FASTRTPS_DEFAULT_PROFILES_FILE", str(Path(__file__).parent / "dds.xml"))
    arguments = parser().parse_args(argv)
    try:
        sys.exit(arguments.command(arguments))
    except LocoError as error:
        from loco_control.exceptions import GraphError

        sys.stderr.write(f"loco: {error}\n")
        sys.exit(1 if isinstance(error, GraphError) else 2)
    except BrokenPipeError:
        os._exit(0)
    except KeyboardInterrupt:
        sys.stderr.write("loco: interrupted\n")
        sys.exit(130)


def parser() -> argparse.ArgumentParser:
    """Parser of the whole command line."""
    top = argparse.ArgumentParser(
        prog="loco",
        description="A compliant quadruped that walks by reflex over ROS 2 topics.",
        epilog=EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    top.add_argument("--version", action="version", version=f"loco {__version__}")
    commands = top.add_subparsers(metavar="COMMAND", required=True)
    cli_run.add(functools.partial(_command, commands))
    _add_reading(commands)
    _add_studies(commands)
    cli_watch.add(functools.partial(_command, commands))
    _add_rest(commands)
    return top


def _command(commands, name: str, function, text: str, more: str = "") -> argparse.ArgumentParser:
    made = commands.add_parser(
        name,
        help=text,
        description=text + ("\n\n" + more if more else ""),
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    made.set_defaults(command=function)
    return made


def _add_reading(commands) -> None:
    p = _command(commands, "demo", demo, "run hyq_trot_reflex, replay its bag, write its report")
    p.add_argument("--out", type=Path, help="new bag folder (default bags/NAME_TIME)")
    p = _command(commands, "list", list_, "show experiments, studies, effects, topics and bags")
    p.add_argument("what", nargs="?", help="experiments, studies, effects, topics or bags")
    from .console_logs import add_arguments

    add_arguments(commands, _command)
    p = _command(commands, "report", report, "write one self-contained HTML page about a bag")
    p.add_argument("bag", type=Path, help="bag folder or .mcap file")
    p.add_argument("--out", type=Path, help="HTML file (default report.html in the bag folder)")
    p.add_argument("--no-gif", action="store_true", help="leave the animation out (faster)")
    p = _command(commands, "extract", extract, "copy some topics of a bag into a smaller bag")
    p.add_argument("bag", type=Path, help="bag folder or .mcap file")
    p.add_argument("out", type=Path, help="new bag folder")
    p.add_argument("--topics", nargs="+", required=True, metavar="TOPIC[:N]",
                   help="names; with N each N-th message")  # fmt: skip


def _add_studies(commands) -> None:
    p = _command(
        commands, "study", study, "run a study: variants x seeds, table and figures (resumable)"
    )
    p.add_argument("study", help="name (see `loco list studies`) or path of a YAML file")
    p.add_argument("--workers", type=int, default=2, help="processes (default 2)")
    p.add_argument("--out", type=Path, help="results folder (default results/NAME)")
    p.add_argument("--seeds", type=int, help="only the first N seeds")
    _add_calibrate(commands)
    _add_optimise(commands)
    p = _command(
        commands, "reproduce", reproduce, "run experiments of the thesis again, claim by claim",
        "msd: chapter 6, networks of masses and springs. Stop it and start it again: it goes on.",
    )  # fmt: skip
    p.add_argument("what", help="msd")
    p.add_argument("--quick", action="store_true", help="the plan quick: a few minutes")
    plans = "quick, medium (half an hour) or full (2 hours on 2 cores; default)"
    p.add_argument("--plan", default="full", help=plans)
    p.add_argument("--preset", default="thesis", help="thesis or author_code")
    p.add_argument("--workers", type=int, default=2, help="processes (default 2)")
    p.add_argument("--scheduler", default="", help="dask scheduler to use instead, tcp://HOST:PORT")
    p.add_argument("--out", type=Path, help="results folder (default results/msd_PRESET_PLAN)")
    p = _command(commands, "bench", bench, "measure speed beside named baselines")
    p.add_argument(
        "what", help="rls, graph, messages, bag, damage, msd, population, realtime or effects"
    )
    p.add_argument("--json", type=Path, help="write the rows to this file too")
    p.add_argument("--seconds", type=float, help="realtime: of each measurement (default 60)")
    p.add_argument("--rate", type=float, help="realtime: ticks per second (default 250)")
    p.add_argument("--layout", help="realtime: composed (default) or processes")


def _add_optimise(commands) -> None:
    p = _command(
        commands, "optimise", optimise, "search a gait by CMA-ES over rollouts (resumable)",
        "The oscillators' amplitudes, duty factors, offsets and phase for the highest forward\n"
        "speed over a rollout; a fall is worse than standing. Stop it and start it again with\n"
        "the same arguments: it goes on to the same end.",
    )  # fmt: skip
    p.add_argument("gait", help="tigrillo_bound or tigrillo_walk")
    p.add_argument("--robot", default="tigrillo", help="robot, robot.yaml or model.yaml")
    p.add_argument("--seeds", type=int, default=1, help="searches, each from its own seed")
    p.add_argument("--seed", type=int, default=0, help="first seed")
    p.add_argument("--evaluations", type=int, default=600, help="rollouts per seed (default 600)")
    p.add_argument("--population", type=int, default=10, help="rollouts per generation")
    p.add_argument("--sigma", type=float, default=0.2, help="first step size, share of the ranges")
    p.add_argument("--plateau", type=int, default=0,
                   help="stop after so many generations without improvement")  # fmt: skip
    p.add_argument("--duration", type=float, default=15.0, help="of a rollout [s]")
    p.add_argument("--frequency", type=float, default=1.0, help="strides per second [Hz]")
    p.add_argument("--randomise", type=float, default=0.0, metavar="SHARE",
                   help="spread of stiffness, friction and masses, e.g. 0.1")  # fmt: skip
    p.add_argument("--samples", type=int, default=1, help="bodies per evaluation")
    p.add_argument("--from", dest="start", type=Path, metavar="GAIT.yaml",
                   help="start from the parameters of a gait")  # fmt: skip
    p.add_argument("--workers", type=int, default=2, help="processes (default 2)")
    p.add_argument("--scheduler", default="", help="dask scheduler to use instead, tcp://HOST:PORT")
    p.add_argument("--out", type=Path, help="folder (default results/GAIT)")
    p.add_argument("--gif", action="store_true", help="draw the best gait, too")


def _add_calibrate(commands) -> None:
    p = _command(
        commands, "calibrate", calibrate,
        "fit a robot's body to a recorded bag (thesis chapter 5, resumable)",
        "The bag holds joint_states and joint_command of a robot whose driven joints were\n"
        "moved periodically. Writes model.yaml, calibration.json, tables, figures and a page.",
    )  # fmt: skip
    p.add_argument("bag", type=Path, nargs="?", help="bag folder or .mcap file")
    p.add_argument("--robot", default="tigrillo", help="robot, robot.yaml or model.yaml")
    p.add_argument("--parameters", default="seven", help="seven (eq. 5.1) or ten (author's code)")
    p.add_argument("--loss", default="thesis", help="thesis (eq. 5.4) or author (normalised)")
    p.add_argument("--seeds", type=int, default=5, help="searches (default 5)")
    p.add_argument("--seed", type=int, default=0, help="seed of the first search")
    p.add_argument("--generations", type=int, help="most generations of a search")
    p.add_argument("--validate", type=Path, nargs="*", default=[], metavar="BAG",
                   help="recordings that are compared but not fitted")  # fmt: skip
    p.add_argument("--out", type=Path, help="results folder (default results/calibration_BAG)")
    p.add_argument("--workers", type=int, default=2, help="processes (default 2)")
    p.add_argument("--scheduler", default="", help="address of a dask cluster instead")
    p.add_argument("--live", action="store_true",
                   help="no bag: start a surrogate robot and a model, fit over topics")  # fmt: skip
    p.add_argument("--measured", default="surrogate_sine", metavar="EXPERIMENT",
                   help="--live: the robot that stands for the real one")  # fmt: skip
    p.add_argument("--speed", type=float, default=1.0,
                   help="--live: at most this x real time, 0 for no limit")  # fmt: skip


def _add_rest(commands) -> None:
    p = _command(commands, "docs", docs, "print the generated tables of docs/ (topics, parameters)")
    p.add_argument("--write", action="store_true", help="write them into docs/")
    p.add_argument("--figures", action="store_true", help="draw the pictures of the effects anew")
    p = commands.add_parser(
        "test", help="run the tests (arguments go to pytest)", add_help=False, prefix_chars="\0"
    )
    p.add_argument("arguments", nargs=argparse.REMAINDER)
    p.set_defaults(command=test)
    p = commands.add_parser(
        "gap", help="find where a model and a recording differ, and name the cause",
        add_help=False, prefix_chars="\0",
    )  # fmt: skip
    p.add_argument("arguments", nargs=argparse.REMAINDER)
    p.set_defaults(command=gap)


# ---- commands: each returns the exit code


def demo(a: argparse.Namespace) -> int:
    """`loco demo`."""
    from .demo import run_demo

    return run_demo(a.out)


def list_(a: argparse.Namespace) -> int:
    """`loco list`."""
    from .listing import show

    show(a.what)
    return 0


def report(a: argparse.Namespace) -> int:
    """`loco report`."""
    from .report import write_report

    sys.stdout.write(f"{write_report(a.bag, a.out, gif=not a.no_gif)}\n")
    return 0


def extract(a: argparse.Namespace) -> int:
    """`loco extract`."""
    from .bag_copy import extract as copy

    sys.stdout.write(f"{copy(a.bag, a.out, a.topics)}\n")
    return 0


def study(a: argparse.Namespace) -> int:
    """`loco study`."""
    from .console import show_study

    return show_study(a.study, a.out, a.workers, a.seeds)


def calibrate(a: argparse.Namespace) -> int:
    """`loco calibrate`."""
    from loco_control.exceptions import ParameterError

    if a.live and a.bag is None:
        from .console_live import show_live

        return show_live(a)
    if a.live or a.bag is None:
        raise ParameterError("loco calibrate takes either a bag or --live")
    from .console_calibrate import show_calibration

    return show_calibration(a)


def gap(a: argparse.Namespace) -> int:
    """`loco gap`, `loco gap next`, `loco gap battery`."""
    from .gap_command import from_arguments

    return from_arguments(a.arguments)


def optimise(a: argparse.Namespace) -> int:
    """`loco optimise`."""
    from .optimise import from_arguments

    return from_arguments(a)


def reproduce(a: argparse.Namespace) -> int:
    """`loco reproduce`."""
    from .reproduce import from_arguments

    return from_arguments(a)


def bench(a: argparse.Namespace) -> int:
    """`loco bench`."""
    from .bench import show_bench

    options = {key: getattr(a, key) for key in ("seconds", "rate", "layout")}
    show_bench(a.what, a.json, **{key: value for key, value in options.items() if value})
    return 0


def docs(a: argparse.Namespace) -> int:
    """`loco docs`."""
    from .docs import show_docs

    show_docs(a.write, a.figures)
    return 0


def test(a: argparse.Namespace) -> int:
    """`loco test`."""
    from loco_control.exceptions import MissingFileError

    root = Path(__file__).resolve().parents[4]
    if not (root / "tests").is_dir():
        raise MissingFileError(
            f"no tests folder in {root}; run this from a clone of the repository"
        )
    arguments = a.arguments or ALL_TESTS
    return subprocess.run([sys.executable, "-m", "pytest", *arguments], cwd=root).returncode


if __name__ == "__main__":
    main()
