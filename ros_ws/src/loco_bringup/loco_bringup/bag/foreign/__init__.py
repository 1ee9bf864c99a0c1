# SPDX-License-Identifier: Apache-2.0
"""Bags of other recorders: in SQLite, packed, of ROS 1."""
