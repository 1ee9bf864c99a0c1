# SPDX-License-Identifier: Apache-2.0
"""CMA-ES and the processes that evaluate its populations."""
