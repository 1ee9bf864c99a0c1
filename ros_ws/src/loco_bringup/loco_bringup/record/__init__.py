# SPDX-License-Identifier: Apache-2.0
"""Record graphs, replay bags and verify controllers against bags."""
