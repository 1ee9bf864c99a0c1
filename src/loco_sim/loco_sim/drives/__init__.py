# SPDX-License-Identifier: Apache-2.0
"""Torque loops: from commands to joint torques at the physics step."""
