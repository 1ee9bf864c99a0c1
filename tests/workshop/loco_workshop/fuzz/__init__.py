# SPDX-License-Identifier: Apache-2.0
"""Damaged input for every parser: what is not one error of ours is a find."""
