# SPDX-License-Identifier: Apache-2.0
"""Experiments that excite a robot, and the choice of the most informative next one."""
