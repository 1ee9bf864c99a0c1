# SPDX-License-Identifier: Apache-2.0
"""Commands `loco robot`: list robots, and create one from a URDF."""
