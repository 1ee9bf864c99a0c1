# SPDX-License-Identifier: Apache-2.0
"""Generators of the URDF files of HyQ and Tigrillo."""
