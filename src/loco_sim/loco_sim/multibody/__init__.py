# SPDX-License-Identifier: Apache-2.0
"""Equations of motion of trees of rigid bodies, compiled."""
