# SPDX-License-Identifier: Apache-2.0
"""A first robot folder from any URDF: what is in it is read, what is not is guessed and said."""
