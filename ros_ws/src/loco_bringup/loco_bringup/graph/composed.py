# SPDX-License-Identifier: Apache-2.0
"""Process of one or several nodes: ``python -m loco_bringup.graph.composed MODULE:CLASS …``."""

from __future__ import annotations

import importlib
import sys

from loco_control.ros.executor import run_nodes


def main() -> None:
    """Run the node classes named on the command line until a signal."""
    split = sys.argv.index("--ros-args") if "--ros-args" in sys.argv else len(sys.argv)
    classes = []
    for path in sys.argv[1:split]:
        module, _, name = path.partition(":")
        classes.append(getattr(importlib.import_module(module), name))
    sys.exit(run_nodes(classes, sys.argv[split:]))


if __name__ == "__main__":
    main()
