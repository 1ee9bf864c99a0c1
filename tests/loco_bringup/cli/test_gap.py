# SPDX-License-Identifier: Apache-2.0
"""Settings of a search on the command line of `loco gap`."""

import pytest

from loco_bringup.cli import table
from loco_bringup.gap.run import options_of
from loco_bringup.gap.terminal import job_of
from loco_control.exceptions import LocoError


def job(*settings):
    pairs = [text for pair in settings for text in ("--set", pair)]
    job, _ = job_of(table.parser("gap").parse_args(["bag", "--robot", "tigrillo", *pairs]))
    return options_of(job)


def test_settings_are_those_of_the_search():
    params = job("accuracy=0.1", "screen_seconds=20")
    assert (params.accuracy, params.screen_seconds) == (0.1, 20.0)


@pytest.mark.parametrize("pair", ["accuracy=0.9", "acuracy=0.1", "accuracy"])
def test_a_wrong_setting_is_one_line(pair):
    with pytest.raises(LocoError) as error:
        job(pair)
    assert "accuracy" in str(error.value) and "\n" not in str(error.value)
