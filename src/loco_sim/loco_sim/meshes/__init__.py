# SPDX-License-Identifier: Apache-2.0
"""Mesh files of others, read within bounds."""
