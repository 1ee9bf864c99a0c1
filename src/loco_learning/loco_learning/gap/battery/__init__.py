# SPDX-License-Identifier: Apache-2.0
"""Blind battery: robots with a hidden effect, made by code that shares nothing with the plant."""
