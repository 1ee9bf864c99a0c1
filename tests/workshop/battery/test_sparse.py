# SPDX-License-Identifier: Apache-2.0
"""Baselines find what is plain to see."""

from __future__ import annotations

import numpy as np
import pytest

from loco_learning.gap.recordings.record import Record
from loco_workshop.battery import sparse
from loco_workshop.battery.physics import excitation, machines, plant
from loco_workshop.battery.physics.hidden import Hidden

pytestmark = pytest.mark.usefixtures("short")


def test_small_terms_go():
    rng = np.random.default_rng(1)
    library = rng.normal(size=(500, 4))
    found = sparse.thresholded(library, 2.0 * library[:, 1] + 0.01 * library[:, 2], 0.1)
    assert np.flatnonzero(found).tolist() == [1]


@pytest.mark.parametrize("lost", [0.0, 0.05])
def test_viscous_friction_is_among_the_terms(lost):
    """Also where readings were lost on their way."""
    m = machines.get("linear_axis")
    moved = excitation.command(m, "chirp", 3)
    hidden = Hidden("viscous_friction", "slide", "damping", {"damping": 20.0})
    r = plant.record(m, [hidden], moved, 1)
    command = {"position": r.command, "velocity": r.rate}
    q = np.where(np.random.default_rng(2).random((len(r.q), 1)) < lost, np.nan, r.q)
    record = Record("x", r.t, command, r.driven, {"q": q}, r.joints)
    found = sparse.discover("linear_axis", [record], 0.08, 0.15)
    damping = next(e["damping"] for e in found if e["name"] == "viscous_friction")
    assert 14.0 < damping < 26.0
