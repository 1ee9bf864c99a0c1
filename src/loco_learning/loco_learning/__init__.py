# SPDX-License-Identifier: Apache-2.0
"""Learning and identification: reflex network, gait search, calibration, gap search, studies."""

__version__ = "0.2.0"
