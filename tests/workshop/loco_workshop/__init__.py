# SPDX-License-Identifier: Apache-2.0
"""Developer tools that test and measure loco itself; not part of the installed packages."""
