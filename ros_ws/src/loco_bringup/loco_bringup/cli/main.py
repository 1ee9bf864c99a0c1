# SPDX-License-Identifier: Apache-2.0
"""Entry point of the `loco` command: help, and one error line for every mistake."""

from __future__ import annotations

import errno
import gc
import logging
import os
import sys
from typing import NoReturn

from loco_control.exceptions import GraphError, LocoError, short

from .. import __version__
from . import clone
from .table import COMMANDS, GROUPS, call, parser, split

HEAD = """\
usage: loco COMMAND [options]

Runs compliant quadrupeds that walk by reflex over ROS 2 topics, and says why a simulation
and a recording differ.
"""
FOOT = """\
loco COMMAND --help   shows the options of a command; --version shows the version
--out is a folder, or the file if a command writes one alone. Without it recordings
            go to bags/, what is about one recording beside it, all else to results/
exit codes: 0 done, 1 a run failed (node died, not ready), 2 a mistake in the input,
            3 the robot fell, 130 interrupted
examples:
  loco gap BAG... --robot tigrillo           why does my model not do what the robot did?
  loco demo                                  run, record, report: the whole chain
  loco run hyq_trot_open --layout processes --clock realtime
  loco run my_experiment.yaml --seed 3 --set gait.speed=0.3
  loco report bags/hyq_trot_reflex_...       one HTML page with figures and a GIF
"""
# Advice for errors of the operating system.
REMEDIES = {
    errno.ENOSPC: "free some space, or choose another place with --out",
    errno.EDQUOT: "free some space, or choose another place with --out",
    errno.EROFS: "choose a folder that can be written with --out",
    errno.EACCES: "choose another place, or ask for the permission",
    errno.ENAMETOOLONG: "choose a shorter name",
}


def main(argv: list[str] | None = None) -> None:
    """Run the command line; an error prints one line on stderr and sets the exit code."""
    logging.basicConfig(level=logging.WARNING, format="loco: %(message)s")
    os.environ["PYTHONSAFEPATH"] = "1"  # child processes import nothing from the current folder
    if argv is None:  # a process of its own; another one keeps its garbage collection
        # Imports and compilation make objects that stay: collection took a tenth of their time.
        gc.set_threshold(50_000)
        # NumPy is not imported yet. A second thread of its linear algebra doubles processor time.
        os.environ.setdefault("OMP_NUM_THREADS", "1")
        os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    try:
        sys.exit(_run(sys.argv[1:] if argv is None else argv))
    except LocoError as error:
        _fail(str(error), 1 if isinstance(error, GraphError) else 2)
    except BrokenPipeError:
        os._exit(0)
    except OSError as error:
        _fail(describe(error), 2)
    except (MemoryError, ImportError) as error:
        if isinstance(error, ImportError) and "failed to map segment" not in str(error):
            raise
        _fail("there is not enough memory; end other programs, or raise the limit `ulimit -v`", 1)
    except ValueError as error:
        if "null byte" not in str(error) and "null character" not in str(error):
            raise
        _fail("a name of a file holds a null byte; choose another name", 2)
    except KeyboardInterrupt:
        _fail("interrupted", 130)


def _run(arguments: list[str]) -> int:
    first = arguments[0] if arguments else "help"
    if first == "--version":
        sys.stdout.write(f"loco {__version__}\n")
    elif first not in ("help", "--help", "-h"):
        return call(*arguments)
    elif len(arguments) > 1:
        name, _ = split(arguments[1:])
        command = COMMANDS[name]
        sys.stdout.write(parser(name).format_help() if command.options else f"{command.text}\n")
    else:
        sys.stdout.write(summary())
    return 0


def summary() -> str:
    """Text of ``loco --help``: all commands by group."""
    width = max(map(len, COMMANDS)) + 2
    parts = [HEAD]
    for title, commands in GROUPS.items():
        lines = [f"  {name:{width}}{command.text}\n" for name, command in commands.items()]
        parts.append(f"{title}\n" + "".join(lines))
    return "\n".join([*parts, FOOT])


def describe(error: OSError) -> str:
    """One line about an error of the operating system: cause, file, and advice."""
    names = [str(name) for name in (error.filename, error.filename2) if name is not None]
    text = ": ".join([error.strerror or str(error) or type(error).__name__, *names[:1]])
    remedy = REMEDIES.get(error.errno or 0)
    return short(" ".join(text.split())) + (f"; {remedy}" if remedy else "")


def _fail(text: str, code: int) -> NoReturn:
    if not clone.is_one():
        text = text.replace("./loco ", "loco ")
    sys.stderr.write(f"loco: {text}\n")
    sys.exit(code)


if __name__ == "__main__":
    main()
