# SPDX-License-Identifier: Apache-2.0
"""Mass-spring-damper networks: structure, kernels, and a simulation of one or of many."""
