# SPDX-License-Identifier: Apache-2.0
"""Third learning step: reinforcement learning improves a trained reflex on the plant."""
