# SPDX-License-Identifier: Apache-2.0
"""Robots at the terminal: a new one from a URDF, and those that there are."""
