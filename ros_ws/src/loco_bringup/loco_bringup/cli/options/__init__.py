# SPDX-License-Identifier: Apache-2.0
"""Options of every command, one module per group, without slow imports."""
