# SPDX-License-Identifier: Apache-2.0
"""Fork server that has imported the tests' dependencies and forks a process per mutant.

``python -m loco_workshop.mutants.nursery ROOT MODULE TEST…`` reads lines of JSON, each with
the changed source ``text`` and the ``allowed`` seconds, and prints for each the exit code of
pytest (a negative signal number if killed), or ``timeout``.
"""

from __future__ import annotations

import json
import os
import shutil
import signal
import sys
import tempfile
import time
from contextlib import suppress
from pathlib import Path
from typing import NoReturn

import pytest


def main() -> None:
    """Serve requests until standard input ends."""
    root, module, *tests = sys.argv[1:]
    os.chdir(root)
    replies = os.fdopen(os.dup(1), "w", buffering=1)
    silence = os.open(os.devnull, os.O_RDWR)
    for stream in (1, 2):
        os.dup2(silence, stream)
    flags = ["-q", "-x", "-n", "0", "-p", "no:cacheprovider", *tests]
    pytest.main([*flags, "--collect-only"])  # imports all dependencies of the tests
    for line in sys.stdin:
        job = json.loads(line)
        replies.write(f"{_tested(Path(root), Path(module), job['text'], job['allowed'], flags)}\n")


def _tested(root: Path, module: Path, text: str, allowed: float, words: list[str]) -> int | str:
    """Result of the tests of a mutant; afterwards all processes that they started are killed."""
    package = module.parent
    while (root / package.parent / "__init__.py").exists():
        package = package.parent
    with tempfile.TemporaryDirectory(prefix="loco_mutant_") as folder:
        sources, scratch = Path(folder, "sources"), Path(folder, "tmp")
        scratch.mkdir()
        # Symbolic links are resolved, since their targets are not copied. Byte code stays behind:
        # it would stand for a mutant of equal size and equal second.
        compiled = shutil.ignore_patterns("__pycache__")
        shutil.copytree(root / package, sources / package.name, ignore=compiled)
        Path(folder, "tests").symlink_to(root / "tests")  # or the copy would be in no clone
        (sources / module.relative_to(package.parent)).write_text(text, encoding="utf-8")
        process = os.fork()
        if not process:
            _test(str(root), str(sources), str(scratch), words)
        end = _wait(process, allowed)
        with suppress(ProcessLookupError):
            os.killpg(process, signal.SIGKILL)
        if end is None:
            os.waitpid(process, 0)
        return "timeout" if end is None else end


def _wait(process: int, allowed: float) -> int | None:
    deadline = time.monotonic() + allowed
    while time.monotonic() < deadline:
        exited, status = os.waitpid(process, os.WNOHANG)
        if exited:
            return os.waitstatus_to_exitcode(status)
        time.sleep(0.01)
    return None


def _test(root: str, sources: str, scratch: str, words: list[str]) -> NoReturn:
    """Run the tests in the forked process, which re-imports modules, preferably from the copy."""
    code = int(pytest.ExitCode.INTERNAL_ERROR)
    try:
        os.setsid()
        sys.dont_write_bytecode = True
        tempfile.tempdir = os.environ["TMPDIR"] = scratch
        sys.path.insert(0, sources)
        paths = [sources, *filter(None, [os.environ.get("PYTHONPATH")])]
        os.environ["PYTHONPATH"] = os.pathsep.join(paths)
        # No attribute access, which would import lazy modules.
        files = {
            name: object.__getattribute__(each, "__dict__").get("__file__") or ""
            for name, each in sys.modules.items()
        }
        packages = {
            name.partition(".")[0] for name, file in files.items()
            if file.startswith(root) and "site-packages" not in file and name != "__main__"
        }  # fmt: skip
        for name in files:
            if name.partition(".")[0] in packages:
                del sys.modules[name]
        code = int(pytest.main(words))
    finally:
        os._exit(code)


if __name__ == "__main__":
    main()
