# SPDX-License-Identifier: Apache-2.0
"""Command `loco study`, and the page about a study."""
