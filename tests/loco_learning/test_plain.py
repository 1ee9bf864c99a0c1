# SPDX-License-Identifier: Apache-2.0
"""Values on their way to JSON."""

import json

import numpy as np

from loco_learning.plain import plain


def test_what_is_told_is_json():
    told = plain({"a": (np.float64(1.5), np.nan, np.inf), 2: np.arange(2), "b": np.bool_(1)})
    assert json.loads(json.dumps(told, allow_nan=False)) == told
    assert told == {"a": [1.5, None, None], "2": [0, 1], "b": True}
