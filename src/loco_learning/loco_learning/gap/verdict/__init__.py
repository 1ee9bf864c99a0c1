# SPDX-License-Identifier: Apache-2.0
"""Verdict on the gap: named, ambiguous, unknown or no gap, with the evidence."""
