# SPDX-License-Identifier: Apache-2.0
"""`loco docs`: reference pages generated from the code."""
