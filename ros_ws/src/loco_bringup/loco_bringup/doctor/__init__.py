# SPDX-License-Identifier: Apache-2.0
"""`loco doctor`: why nothing moves."""
