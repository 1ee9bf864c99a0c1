# SPDX-License-Identifier: Apache-2.0
"""Install the requirements of a lock file: with uv, or with several pips at once.

uv unpacks in a fifth of pip's processor time, and a package that it has unpacked before is only
linked. It reads no configuration of pip: where pip is told another index, and where uv cannot be
had or fails, four pips install, each a part. No requirement depends on the order, as each is
locked and nothing is resolved.

    .venv/bin/python requirements/install.py requirements/lock.txt
"""

import re
import subprocess
import sys
import tempfile
from pathlib import Path

PARTS = 4
LOCKED = ["--require-hashes", "--no-deps"]
PIP = [sys.executable, "-m", "pip"]
INSTALL = [*PIP, "install", *LOCKED, "--no-compile"]
INSTALL += ["--disable-pip-version-check", "--progress-bar", "off"]  # a fifth of a second in each
OWN_INDEX = re.compile(r"(?m)^\S+\.(index-url|no-index|proxy)=")  # in pip's configuration


def blocks(text: str) -> list[str]:
    """Requirements of a lock file: each begins a line, what goes on is indented."""
    return re.split(r"(?m)^(?=[a-z0-9])", text)[1:]


def split(text: str, parts: int = PARTS) -> list[str]:
    """Requirements of a lock file in parts; packages that share a file stay together.

    Args:
        text: Content of the file.
        parts: Number of parts.
    """
    made, place = [""] * parts, {}
    for block in blocks(text):
        name = block.partition("=")[0]
        # mujoco and mujoco-core both have mujoco/__init__.py; wheels of ROS share nothing.
        family = name if name.startswith("ros-") else name.partition("-")[0]
        made[place.setdefault(family, len(place) % parts)] += block
    return [part for part in made if part]


def find_uv(folder: Path) -> "Path | None":
    """The locked uv, installed beside this Python; None where pip has its own index or no uv.

    Args:
        folder: For a file of requirements.
    """
    told = subprocess.run([*PIP, "config", "list"], stdout=subprocess.PIPE, text=True)
    if told.returncode or OWN_INDEX.search(told.stdout):
        return None
    uv, tools = Path(sys.executable).with_name("uv"), Path(__file__).with_name("dev.txt")
    path = folder / "uv.txt"
    path.write_text(next(b for b in blocks(tools.read_text()) if b.startswith("uv==")))
    got = subprocess.run([*INSTALL, "--only-binary", ":all:", "-r", path])  # not from Rust sources
    return uv if got.returncode == 0 and uv.exists() else None


def main(lock: Path) -> int:
    """Install all requirements of a lock file; the exit code is that of a pip that failed, or 0."""
    with tempfile.TemporaryDirectory() as name:
        folder, pips = Path(name), []
        if uv := find_uv(folder):
            words = [uv, "pip", "install", "--python", sys.executable, *LOCKED, "-r", lock]
            if subprocess.run([*words, "--no-progress"]).returncode == 0:
                return 0
        for number, part in enumerate(split(lock.read_text())):
            path = folder / f"part{number}.txt"
            path.write_text(part)
            pips.append(subprocess.Popen([*INSTALL, "-r", path]))
        codes = [pip.wait() for pip in pips]
    return max(map(abs, codes))


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1])))
