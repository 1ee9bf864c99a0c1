# SPDX-License-Identifier: Apache-2.0
"""Harnesses that test and measure loco itself; no run of a user needs them."""
