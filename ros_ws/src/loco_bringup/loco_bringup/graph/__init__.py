# SPDX-License-Identifier: Apache-2.0
"""Start, monitor and stop the nodes of a run."""
