# SPDX-License-Identifier: Apache-2.0
"""Mutation testing of the code that protects robots and recordings."""
