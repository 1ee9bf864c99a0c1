# SPDX-License-Identifier: Apache-2.0
"""Drivers of real robots with servos on a bus, and a simulated bus."""
