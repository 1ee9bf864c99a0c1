# SPDX-License-Identifier: Apache-2.0
"""The claims of the thesis: a registry with rules, plans of runs, and what the runs measure."""
