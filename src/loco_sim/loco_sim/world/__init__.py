# SPDX-License-Identifier: Apache-2.0
"""The physics engine, the ground and pictures, behind one door."""
