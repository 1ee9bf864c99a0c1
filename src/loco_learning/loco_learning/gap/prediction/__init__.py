# SPDX-License-Identifier: Apache-2.0
"""Predictions of a model where a robot was measured, and the residual."""
