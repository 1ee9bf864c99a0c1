# SPDX-License-Identifier: Apache-2.0
"""The reflex network: reservoir, readout, schedule, scaling and stored weights."""
