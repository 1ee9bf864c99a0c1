# SPDX-License-Identifier: Apache-2.0
"""An experiment in, a log out, without ROS."""
