# SPDX-License-Identifier: Apache-2.0
"""Studies on the terminal, and the page with the maps of a grid."""
