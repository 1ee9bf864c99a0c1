# SPDX-License-Identifier: Apache-2.0
"""A model for other simulators: MJCF, URDF, Isaac Lab and PACE, and ranges to randomise in."""
