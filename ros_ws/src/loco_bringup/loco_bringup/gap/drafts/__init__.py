# SPDX-License-Identifier: Apache-2.0
"""`loco gap mapping`: draft of a mapping file for tables and bags."""
