# SPDX-License-Identifier: Apache-2.0
"""Creation of a robot folder from a URDF; missing values are guessed and reported."""
