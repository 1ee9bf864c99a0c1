# SPDX-License-Identifier: Apache-2.0
"""Two running robots, one fitted to the other over topics."""
