# SPDX-License-Identifier: Apache-2.0
"""The plant: robots in PyBullet with named physical effects, stepped by control periods."""

__version__ = "0.2.0"
