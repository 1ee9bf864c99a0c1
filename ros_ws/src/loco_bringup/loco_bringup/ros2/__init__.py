# SPDX-License-Identifier: Apache-2.0
"""The ros2 commands that our pages print, for machines without an apt installation of ROS."""
