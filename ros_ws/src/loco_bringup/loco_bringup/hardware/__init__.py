# SPDX-License-Identifier: Apache-2.0
"""Commands under `loco hardware`."""
