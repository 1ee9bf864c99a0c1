# SPDX-License-Identifier: Apache-2.0
"""Checks of the set-up of recordings and robot, before any physical effect is sought."""
