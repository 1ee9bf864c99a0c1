# SPDX-License-Identifier: Apache-2.0
"""Topics of a calibration; the robots that it listens to have tables of their own.

Beside them is the action ``calibrate`` (``loco_msgs/action/Calibrate``).
"""

from __future__ import annotations

from loco_msgs.msg import CalibrationState, Gap

from .topics import LATCHED_LOG, STATE, TOPICS, Topic

CALIBRATOR = "calibrator"

CALIBRATION_TOPICS = {
    topic.name: topic
    for topic in (
        Topic(
            "calibration",
            CalibrationState,
            LATCHED_LOG,
            0,
            CALIBRATOR,
            (),
            "progress of a calibration and how it ended",
        ),
        Topic(
            "gap",
            Gap,
            STATE,
            0,
            CALIBRATOR,
            (),
            "how far the model is from the measured robot, once per period of the actuation",
        ),
        TOPICS["/diagnostics"],
        TOPICS["events"],
    )
}
