# SPDX-License-Identifier: Apache-2.0
"""`loco reproduce`: repeat experiments of the thesis and check its claims."""
