# SPDX-License-Identifier: Apache-2.0
"""Torque loops of the drives: joint torques from commands at each physics step."""
