# SPDX-License-Identifier: Apache-2.0
"""Recordings on an even time axis: signals by joint, mapping, units, clocks and findings."""
