# SPDX-License-Identifier: Apache-2.0
"""Tasks for a worker process, which imports them by this module's name."""

from __future__ import annotations

import time

from loco_sim.plant import model as models


def call(share, stage, best, tell):
    """Tell once and return the best."""
    tell(share, stage, best)
    return best


def robot(name, tell):
    """Fails for an unknown robot."""
    return models.load_any(name).robot


def sleep(seconds, tell):
    """Return late."""
    time.sleep(seconds)
