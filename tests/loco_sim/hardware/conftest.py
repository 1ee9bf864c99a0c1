# SPDX-License-Identifier: Apache-2.0
"""A bus of simulated servos that a test may disturb."""

from __future__ import annotations

import pytest

from loco_bringup.testing import servo_bus


@pytest.fixture
def bus():
    """The simulated bus of a pendulum on a servo that turns against its joint."""
    with servo_bus() as bus:
        yield bus
