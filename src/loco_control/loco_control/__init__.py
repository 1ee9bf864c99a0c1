# SPDX-License-Identifier: Apache-2.0
"""Control of legged robots: gait, kinematics, trunk and stance; NumPy, with numba for kernels."""

__version__ = "0.2.0"
