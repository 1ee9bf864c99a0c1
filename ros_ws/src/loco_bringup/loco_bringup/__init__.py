# SPDX-License-Identifier: Apache-2.0
"""Running, recording, replaying and reporting the node graph; the `loco` command."""

__version__ = "0.2.0"

import loco_control.ros  # noqa: F401, keeps discovery on this machine
