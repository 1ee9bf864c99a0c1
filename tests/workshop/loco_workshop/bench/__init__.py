# SPDX-License-Identifier: Apache-2.0
"""`loco bench`: speed compared with named baselines."""
