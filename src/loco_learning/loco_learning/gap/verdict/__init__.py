# SPDX-License-Identifier: Apache-2.0
"""Named, ambiguous, unknown or no gap, with the evidence for it."""
