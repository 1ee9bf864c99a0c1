# SPDX-License-Identifier: Apache-2.0
"""Command `loco export-model`: a model for other simulators, and a replay that checks it."""
