# SPDX-License-Identifier: Apache-2.0
"""`loco ros2`: the ros2 commands of the documentation, without an apt installation of ROS."""
