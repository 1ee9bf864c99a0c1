# SPDX-License-Identifier: Apache-2.0
"""Install the requirements of a lock file with several pips at once, each a part of them.

One pip asks for one package after the other and unpacks on one core; four take a third of its
time. No requirement depends on the order, as each is locked and nothing is resolved.

    python requirements/install.py requirements/lock.txt
"""

import re
import subprocess
import sys
import tempfile
from pathlib import Path

PARTS = 4
PIP = ["-m", "pip", "install", "--require-hashes", "--no-deps", "--no-compile"]
PIP += ["--disable-pip-version-check", "--progress-bar", "off"]  # a fifth of a second in each


def split(text: str, parts: int = PARTS) -> list[str]:
    """Requirements of a lock file in parts; packages that share a file stay together.

    Args:
        text: Content of the file: each requirement begins a line, what goes on is indented.
        parts: Number of parts.
    """
    made, place = [""] * parts, {}
    for block in re.split(r"(?m)^(?=[a-z0-9])", text)[1:]:
        name = block.partition("=")[0]
        # mujoco and mujoco-core both have mujoco/__init__.py; wheels of ROS share nothing.
        family = name if name.startswith("ros-") else name.partition("-")[0]
        made[place.setdefault(family, len(place) % parts)] += block
    return [part for part in made if part]


def main() -> int:
    """Install all parts; the exit code is that of a pip that failed, 0 if none did."""
    with tempfile.TemporaryDirectory() as folder:
        pips = []
        for number, part in enumerate(split(Path(sys.argv[1]).read_text())):
            path = Path(folder, f"part{number}.txt")
            path.write_text(part)
            pips.append(subprocess.Popen([sys.executable, *PIP, "-r", str(path)]))
        codes = [pip.wait() for pip in pips]
    return max(map(abs, codes))


if __name__ == "__main__":
    sys.exit(main())
