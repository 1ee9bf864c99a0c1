# SPDX-License-Identifier: Apache-2.0
"""Safe reading of mesh files."""
