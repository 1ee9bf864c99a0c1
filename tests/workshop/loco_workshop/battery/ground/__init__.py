# SPDX-License-Identifier: Apache-2.0
"""Trotting robots with hidden effects, integrated by another engine than that of the search."""
