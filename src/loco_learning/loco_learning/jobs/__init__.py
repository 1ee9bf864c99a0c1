# SPDX-License-Identifier: Apache-2.0
"""Other processes: many short jobs in a pool, or one long computation in a child process."""
