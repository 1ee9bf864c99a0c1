# SPDX-License-Identifier: Apache-2.0
"""Trotting robots with hidden effects, simulated by another engine than in the search."""
