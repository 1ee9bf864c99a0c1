# SPDX-License-Identifier: Apache-2.0
"""A search that knows its answer, for tests of what stands around it; runs in a child process."""

from __future__ import annotations

from loco_bringup.gap import run as gap


def find(job, records, tell):
    """Friction in the first driven joint, after all recordings have been read."""
    if not records:
        _, fit, held = gap.read_records(job)
        records = [*fit, *held]
    for share, stage in ((0.1, "screening"), (0.5, "fitting"), (0.9, "weighing")):
        tell(share, stage, "coulomb_friction")
    joint = records[0].driven[0]
    effect = {"name": "coulomb_friction", "joint": joint, "torque": 0.1 * len(records)}
    term = {"effect": "coulomb_friction", "place": joint, "verdict": "named", "parameters": {}}
    return {
        "format": 1, "verdict": "named", "names": ["coulomb_friction"],
        "terms": [term], "rivals": [],
        "gap": {"before": 12.0, "after": 1.5, "closed": 0.99},
        "model": {"robot": job.robot, "overrides": {}, "effects": [effect]},
    }  # fmt: skip
