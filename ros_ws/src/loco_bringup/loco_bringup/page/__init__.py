# SPDX-License-Identifier: Apache-2.0
"""The toolkit of all HTML pages."""
