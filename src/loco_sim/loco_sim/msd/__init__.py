# SPDX-License-Identifier: Apache-2.0
"""Mass-spring-damper networks: structure, kernels, and simulation of one or many networks."""
