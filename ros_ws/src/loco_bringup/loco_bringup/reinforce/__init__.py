# SPDX-License-Identifier: Apache-2.0
"""The third learning step on the terminal, and its page."""
