# SPDX-License-Identifier: Apache-2.0
"""Preview of recordings before a search: their properties, and the effects visible in them."""
