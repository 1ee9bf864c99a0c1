# SPDX-License-Identifier: Apache-2.0
"""Short records: laws do not need four seconds."""

from __future__ import annotations

import pytest

from loco_workshop.battery import sizes
from loco_workshop.battery.physics import excitation, plant


@pytest.fixture
def short(monkeypatch):
    """Records of one second after a short rest."""
    monkeypatch.setattr(excitation, "DURATION", 1.0)
    monkeypatch.setattr(plant, "SETTLE", 0.2)
    sizes.reference.cache_clear()
    sizes.doubts.cache_clear()
    yield
    sizes.reference.cache_clear()
    sizes.doubts.cache_clear()
