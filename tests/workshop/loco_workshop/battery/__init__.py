# SPDX-License-Identifier: Apache-2.0
"""The blind battery: how often `loco gap` names a hidden effect."""
