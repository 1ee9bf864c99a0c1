# SPDX-License-Identifier: Apache-2.0
"""The place where model and measurement differ, the effect that is missing, and the proof."""
