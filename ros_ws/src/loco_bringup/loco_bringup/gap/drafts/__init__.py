# SPDX-License-Identifier: Apache-2.0
"""`loco gap mapping`: drafts of mappings for tables and bags."""
