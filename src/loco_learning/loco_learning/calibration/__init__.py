# SPDX-License-Identifier: Apache-2.0
"""Calibration of a robot's model against recorded sensor signals (thesis chapter 5).

``recording`` what was measured · ``segments`` periods and their average · ``mawe`` the
two losses · ``parameters`` what may change · ``objective`` how wrong a body is · ``fit``
the search · ``results``, ``tables`` and ``figures`` what was found.
"""
