# SPDX-License-Identifier: Apache-2.0
"""Command `loco gap fleet`, and its page."""
