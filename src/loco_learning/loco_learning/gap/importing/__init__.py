# SPDX-License-Identifier: Apache-2.0
"""Import of recordings: tables, logs of other programs, and signals on one time axis."""
