# SPDX-License-Identifier: Apache-2.0
"""The reflex network that learns to walk, and the experiments that judge it."""

__version__ = "0.2.0"
