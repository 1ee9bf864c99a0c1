# SPDX-License-Identifier: Apache-2.0
"""Experiments, their simulation without ROS, and logs."""
