# SPDX-License-Identifier: Apache-2.0
"""The description of a robot: URDF, drives, springs and sensors as `robot.yaml` lists them."""
