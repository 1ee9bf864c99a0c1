# SPDX-License-Identifier: Apache-2.0
"""Robots with hidden effects, simulated by code that the search does not use."""
