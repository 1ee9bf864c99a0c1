# SPDX-License-Identifier: Apache-2.0
"""The third learning step: reinforcement improves a reflex on the plant that taught it."""
