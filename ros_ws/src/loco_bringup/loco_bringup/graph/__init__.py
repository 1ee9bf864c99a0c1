# SPDX-License-Identifier: Apache-2.0
"""Starts, watches and stops the nodes of a run."""
