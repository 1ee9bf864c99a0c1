# SPDX-License-Identifier: Apache-2.0
"""The ROS 2 rim of loco_sim; nothing above this folder imports ROS."""
