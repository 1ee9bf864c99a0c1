# SPDX-License-Identifier: Apache-2.0
"""Description of a robot: URDF, and drives, springs and sensors from `robot.yaml`."""
