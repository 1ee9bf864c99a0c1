# SPDX-License-Identifier: Apache-2.0
"""The effects, one module per family; `loco_sim.effects` imports each of them."""
