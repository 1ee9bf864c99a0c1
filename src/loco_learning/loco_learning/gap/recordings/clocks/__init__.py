# SPDX-License-Identifier: Apache-2.0
"""Clocks of recordings: where they break, where stamps are late, where two series are mixed."""
