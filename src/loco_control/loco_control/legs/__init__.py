# SPDX-License-Identifier: Apache-2.0
"""Geometry and kinematics of a quadruped's legs."""
