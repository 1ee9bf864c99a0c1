# SPDX-License-Identifier: Apache-2.0
"""Any recorded file as records on one even time axis, checked."""
