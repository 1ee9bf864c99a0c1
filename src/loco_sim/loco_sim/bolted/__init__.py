# SPDX-License-Identifier: Apache-2.0
"""A robot on a bolted base that touches nothing, in one compiled loop without the engine."""
