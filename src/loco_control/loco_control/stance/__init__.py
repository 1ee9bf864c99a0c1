# SPDX-License-Identifier: Apache-2.0
"""The legs that stand, and the torques that hold the trunk level."""
