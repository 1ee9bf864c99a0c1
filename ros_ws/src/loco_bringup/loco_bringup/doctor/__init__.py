# SPDX-License-Identifier: Apache-2.0
"""`loco doctor`: diagnosis of a graph that does not run."""
