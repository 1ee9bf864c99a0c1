# SPDX-License-Identifier: Apache-2.0
"""Legs of a quadruped: their geometry, kinematics, and what scales with their length."""
