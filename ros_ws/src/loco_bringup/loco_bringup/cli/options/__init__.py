# SPDX-License-Identifier: Apache-2.0
"""The options of every command, a module for each group; nothing here imports what is heavy."""
