# SPDX-License-Identifier: Apache-2.0
"""Gaps of a fleet: thousands of recordings of several robots on several days."""
