# SPDX-License-Identifier: Apache-2.0
"""ROS 2 nodes of loco_learning; only this folder imports ROS."""
