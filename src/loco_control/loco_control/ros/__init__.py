# SPDX-License-Identifier: Apache-2.0
"""The ROS 2 rim of loco_control; nothing above this folder imports ROS.

Whoever makes a node or listens to one imports this package first. So this is where discovery is
kept on this machine, unless the user has set ``ROS_AUTOMATIC_DISCOVERY_RANGE``: rclpy reads the
variable when it is initialised.
"""

import os

if not os.environ.get("ROS_AUTOMATIC_DISCOVERY_RANGE"):
    os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] = "LOCALHOST"
