# SPDX-License-Identifier: Apache-2.0
"""Where model and measurement differ, which physical effect is missing, and the proof of it."""
