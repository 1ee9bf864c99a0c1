# SPDX-License-Identifier: Apache-2.0
"""Readers of bags from other recorders: SQLite, compressed bags, ROS 1."""
