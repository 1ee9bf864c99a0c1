# SPDX-License-Identifier: Apache-2.0
"""Looks at recordings before a search: what they are, and what they can tell."""
