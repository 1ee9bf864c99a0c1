# SPDX-License-Identifier: Apache-2.0
"""Experiments that excite a robot, and the one that would tell most."""
