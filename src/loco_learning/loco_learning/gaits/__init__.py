# SPDX-License-Identifier: Apache-2.0
"""Search for gaits of a robot by CMA-ES, and the resulting gait files."""
