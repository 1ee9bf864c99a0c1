# SPDX-License-Identifier: Apache-2.0
"""Predictions of a model at the measured times, and the residuals."""
