# SPDX-License-Identifier: Apache-2.0
"""`loco calibrate`: a robot's body fitted to a recorded bag."""
