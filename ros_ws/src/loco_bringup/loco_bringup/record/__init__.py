# SPDX-License-Identifier: Apache-2.0
"""Records graphs, replays bags and verifies controllers against them."""
