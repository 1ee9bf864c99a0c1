# SPDX-License-Identifier: Apache-2.0
"""Set-up of recordings and robot, judged before any physical effect is sought."""
