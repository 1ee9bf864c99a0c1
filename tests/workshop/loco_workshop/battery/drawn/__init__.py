# SPDX-License-Identifier: Apache-2.0
"""Drawn robots of the battery: bodies, drives, sensors and records from one seed."""
