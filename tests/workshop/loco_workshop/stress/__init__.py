# SPDX-License-Identifier: Apache-2.0
"""`loco chaos`, `loco crash` and `loco soak`: signals, faults, crashes and long runs."""
