# SPDX-License-Identifier: Apache-2.0
"""`loco gap`: find the effects that a model lacks in recordings, and write the mended model."""
