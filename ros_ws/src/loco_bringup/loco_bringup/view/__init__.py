# SPDX-License-Identifier: Apache-2.0
"""Display of runs in the viewers Rerun, Foxglove and RViz."""
