# SPDX-License-Identifier: Apache-2.0
"""The place of the gap: joint, signal, phase, frequency, region."""
