# SPDX-License-Identifier: Apache-2.0
"""Writers of the URDF files of HyQ and Tigrillo."""
