# SPDX-License-Identifier: Apache-2.0
"""Runs that are judged by what they leave have a ROS domain without others."""

import pytest

from loco_bringup.testing import claim_domain


@pytest.fixture(scope="session")
def empty_domain():
    return str(claim_domain())


@pytest.fixture(autouse=True)
def alone(empty_domain, monkeypatch):
    """Participants of other tests live on in this process, and hold ports of whom they heard.

    On a busy machine they let go of those of the dead only after the run was cleaned up.
    """
    monkeypatch.setenv("ROS_DOMAIN_ID", empty_domain)
