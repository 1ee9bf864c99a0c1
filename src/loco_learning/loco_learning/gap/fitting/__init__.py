# SPDX-License-Identifier: Apache-2.0
"""Search over hypotheses: screening, fits, one effect more at a time."""
