# SPDX-License-Identifier: Apache-2.0
"""Drafts of mappings, guessed from names and values of a recording."""
