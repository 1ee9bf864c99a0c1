# SPDX-License-Identifier: Apache-2.0
"""A sensor whose zero or gain is off is an effect, which the search names, and no mistake."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest

from loco_learning.gap.setup.bench import Trial
from loco_learning.gap.setup.bodies import misread
from loco_learning.gap.setup.finding import OFFSET, SCALE

T = np.arange(400) * 0.01
SAID = np.stack([0.2 + 0.3 * np.sin(3.0 * T), 0.5 * np.cos(2.0 * T)], axis=1)


@dataclass
class Read:
    """A bench whose model is right, and whose sensors read `measured`."""

    measured: np.ndarray
    led: bool = False

    def __call__(self, *changes) -> Trial:
        read = self.measured.copy()
        for c in changes:
            i = ("hip", "knee").index(c.joint)
            read[:, i] = read[:, i] * c.value if c.key == SCALE else read[:, i] + c.value
            assert c.key in (SCALE, OFFSET) and c.role == "q"
        return Trial(("hip", "knee"), (SAID,), (read,))

    def miss(self, *changes) -> float:
        return self(*changes).miss()


@pytest.mark.parametrize(("gain", "zero"), [(1.03, 0.0), (0.8, 0.0), (1.0, 0.1)])
@pytest.mark.parametrize("joint", [0, 1])
def test_a_sensor_that_is_off_explains_all(joint, gain, zero):
    measured = SAID.copy()
    measured[:, joint] = gain * measured[:, joint] + zero
    measured[::7] = np.nan  # readings that were lost
    bench = Read(measured)
    assert misread(bench) < 1e-6 < 0.02 < bench.miss()


def test_another_motion_is_no_sensor_that_is_off():
    measured = SAID.copy()
    measured[:, 1] = 0.5 * np.cos(2.0 * T - 0.3)
    bench = Read(measured)
    assert misread(bench) > 0.5 * bench.miss() > 0.05
