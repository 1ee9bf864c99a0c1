# SPDX-License-Identifier: Apache-2.0
"""`loco reproduce`: chapters of the thesis run again, and the page that judges its claims."""
