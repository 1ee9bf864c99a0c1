# SPDX-License-Identifier: Apache-2.0
"""Search over hypotheses: screening, fits, and models of more effects."""
