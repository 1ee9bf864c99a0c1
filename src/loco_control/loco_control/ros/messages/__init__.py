# SPDX-License-Identifier: Apache-2.0
"""Topic tables, and conversion between messages and the types of the controllers."""
