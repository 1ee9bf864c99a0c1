# SPDX-License-Identifier: Apache-2.0
"""The simulated robot as controllers see it: commands in, sensor readings out."""
