# SPDX-License-Identifier: Apache-2.0
"""ROS 2 nodes of loco_sim; no module outside of this folder imports ROS."""
