# SPDX-License-Identifier: Apache-2.0
"""The blind battery: a benchmark of how often `loco gap` names a hidden effect."""
