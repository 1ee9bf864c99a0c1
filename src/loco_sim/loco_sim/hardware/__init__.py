# SPDX-License-Identifier: Apache-2.0
"""Real robots in place of the simulated one: servos on a bus, and a bus that is simulated."""
