# SPDX-License-Identifier: Apache-2.0
"""Import of recorded files as checked records on one even time axis."""
