# SPDX-License-Identifier: Apache-2.0
"""Fuzzing of every parser: damaged input must raise a `LocoError` or be read correctly."""
