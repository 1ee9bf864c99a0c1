# SPDX-License-Identifier: Apache-2.0
"""Probabilities of effects, kinds and places from all models that a search fitted."""
