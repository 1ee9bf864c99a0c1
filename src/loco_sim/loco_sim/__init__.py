# SPDX-License-Identifier: Apache-2.0
"""The plant: simulated robots with named physical effects, stepped by control periods."""

__version__ = "0.2.0"
