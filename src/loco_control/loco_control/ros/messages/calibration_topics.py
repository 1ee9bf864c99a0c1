# SPDX-License-Identifier: Apache-2.0
"""Topics of a calibration; the calibrated robots have topic tables of their own.

There are also the actions ``calibrate`` (``loco_msgs/action/Calibrate``) and ``find_gap``
(``loco_msgs/action/FindGap``).
"""

from __future__ import annotations

from .topics import LATCHED_LOG, STATE, TOPICS, Topic

CALIBRATOR = "calibrator"

CALIBRATION_TOPICS = {
    topic.name: topic
    for topic in (
        Topic("calibration", "loco_msgs/CalibrationState", LATCHED_LOG, 0, CALIBRATOR, (),
              "progress and result of a calibration"),
        Topic("gap", "loco_msgs/Gap", STATE, 0, CALIBRATOR, (),
              "difference between model and measured robot, once per period of the actuation"),
        Topic("gap_search", "loco_msgs/GapSearch", LATCHED_LOG, 0, CALIBRATOR, (),
              "progress and result of a search for the cause of the gap"),
        TOPICS["/diagnostics"],
        TOPICS["events"],
    )
}  # fmt: skip
