# SPDX-License-Identifier: Apache-2.0
"""MCAP bags on disk: write, read, copy, export, recover."""
