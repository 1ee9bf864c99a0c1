# SPDX-License-Identifier: Apache-2.0
"""Commands `loco reinforce` (third learning step: reinforcement), and their page."""
