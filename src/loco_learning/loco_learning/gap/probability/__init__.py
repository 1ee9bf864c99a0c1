# SPDX-License-Identifier: Apache-2.0
"""Probabilities of effects, kinds and places, told beside the rules of the verdict."""
