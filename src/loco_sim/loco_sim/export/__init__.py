# SPDX-License-Identifier: Apache-2.0
"""Export of models to MJCF, URDF, Isaac Lab and PACE, with ranges for domain randomisation."""
