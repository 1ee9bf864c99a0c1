# SPDX-License-Identifier: Apache-2.0
"""Conversion between bags and logs."""
