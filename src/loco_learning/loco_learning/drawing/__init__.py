# SPDX-License-Identifier: Apache-2.0
"""Charts as data: drawn by pages for a reader to explore, and as PNG files."""
