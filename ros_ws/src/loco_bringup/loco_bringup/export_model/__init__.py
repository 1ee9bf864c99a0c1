# SPDX-License-Identifier: Apache-2.0
"""Command `loco export-model`: export a model to other simulators and check it by replay."""
