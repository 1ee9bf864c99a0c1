# SPDX-License-Identifier: Apache-2.0
"""`loco chaos` and `loco soak`: signals, faults and long runs."""
