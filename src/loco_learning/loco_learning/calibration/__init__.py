# SPDX-License-Identifier: Apache-2.0
"""Calibration of a robot's model against recorded sensor signals (thesis chapter 5).

``recording`` measurements · ``segments`` periods and their average · ``mawe`` the
two losses · ``parameters`` calibrated parameters · ``objective`` error of a body · ``fit``
the search · ``results`` and ``figures`` results, tables and figures.
"""
