# SPDX-License-Identifier: Apache-2.0
"""Hypotheses about what is missing in a model, and where."""
