# SPDX-License-Identifier: Apache-2.0
"""Robots with hidden effects, integrated by code that the search does not use."""
