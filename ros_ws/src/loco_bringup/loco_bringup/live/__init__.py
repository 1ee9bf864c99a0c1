# SPDX-License-Identifier: Apache-2.0
"""Calibration and gap search between two running robots, over topics."""
