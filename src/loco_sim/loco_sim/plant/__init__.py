# SPDX-License-Identifier: Apache-2.0
"""The simulated robot from the controllers' side: commands in, sensor readings out."""
