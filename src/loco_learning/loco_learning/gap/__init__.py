# SPDX-License-Identifier: Apache-2.0
"""Search for the gap between model and measurement: where they differ, and the missing effect."""
