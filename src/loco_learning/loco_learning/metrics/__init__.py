# SPDX-License-Identifier: Apache-2.0
"""Metrics of thesis section 3.6: equations and the table of names."""
