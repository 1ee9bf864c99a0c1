# SPDX-License-Identifier: Apache-2.0
"""A folder in tests/untraced.txt is without coverage, fixtures and processes included."""

import os
import sys

import pytest


@pytest.fixture
def traced():
    return sys.gettrace() is not None or "COVERAGE_PROCESS_CONFIG" in os.environ


def test_fixtures_of_this_folder_are_without_coverage(traced):
    assert not traced
