# SPDX-License-Identifier: Apache-2.0
"""Work in other processes: many short jobs in a pool, or one long computation in a child."""
