# SPDX-License-Identifier: Apache-2.0
"""Chapter 6 of the thesis: networks of masses, springs and dampers."""
