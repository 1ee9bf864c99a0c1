# SPDX-License-Identifier: Apache-2.0
"""Stance estimation, and the trunk controller with its ground forces and joint torques."""
