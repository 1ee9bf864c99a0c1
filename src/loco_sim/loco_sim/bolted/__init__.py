# SPDX-License-Identifier: Apache-2.0
"""Compiled simulation, without an engine, of a robot with fixed base and without contacts."""
