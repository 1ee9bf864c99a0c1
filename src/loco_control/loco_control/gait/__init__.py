# SPDX-License-Identifier: Apache-2.0
"""Gait targets: the RCF generator, oscillators (CPG) and excitation signals."""
