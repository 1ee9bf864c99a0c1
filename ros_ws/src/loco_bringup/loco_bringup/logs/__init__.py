# SPDX-License-Identifier: Apache-2.0
"""A bag as a log, and a log as a bag."""
