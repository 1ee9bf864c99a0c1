# SPDX-License-Identifier: Apache-2.0
"""Studies: variants of an experiment times seeds, with tables and figures."""
