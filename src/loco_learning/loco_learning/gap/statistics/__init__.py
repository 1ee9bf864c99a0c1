# SPDX-License-Identifier: Apache-2.0
"""Noise floors, least squares, intervals and odds."""
