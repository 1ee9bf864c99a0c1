# SPDX-License-Identifier: Apache-2.0
"""Runs in viewers: what to show, and how Rerun, Foxglove and RViz show it."""
