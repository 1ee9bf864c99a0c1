# SPDX-License-Identifier: Apache-2.0
"""`loco calibrate`: fit the mechanical parameters of a robot to a recorded bag."""
