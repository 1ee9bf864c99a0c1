# SPDX-License-Identifier: Apache-2.0
"""`loco reliability`: figures of what was measured, and what of a quality level is held."""
