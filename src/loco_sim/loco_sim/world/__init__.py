# SPDX-License-Identifier: Apache-2.0
"""Physics engines behind one interface, the ground, and rendering."""
