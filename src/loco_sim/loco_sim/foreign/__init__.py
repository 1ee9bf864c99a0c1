# SPDX-License-Identifier: Apache-2.0
"""Import of third-party robot files: reading, repair and plausibility checks."""
