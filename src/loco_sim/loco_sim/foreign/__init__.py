# SPDX-License-Identifier: Apache-2.0
"""Robot files as others write them: read, cured and held against themselves."""
