# SPDX-License-Identifier: Apache-2.0
"""The search: callback per generation, cancel, resume, plain results."""

from __future__ import annotations

import json

import numpy as np
import pytest

from loco_control.exceptions import ParameterError
from loco_learning.calibration.fit import Calibration, start
from loco_learning.calibration.parameters import parameter_set
from loco_learning.calibration.progress import Fit, Generation, fit_from_dict, plateau


def test_the_best_of_the_search_is_what_its_model_scores(recording, quick):
    calibration, told = Calibration(recording, "tigrillo", quick), []
    fit = calibration.run(told.append)
    assert [g.index for g in told] == [1, 2]
    assert told == fit.history
    assert fit.error == min(fit.before, *(g.best for g in told))
    again = calibration.reference.compare(calibration.model(fit.values))
    assert again.error["thesis"] == pytest.approx(fit.error)
    assert fit.before == calibration.before.error["thesis"]


def test_cancel_ends_it_with_what_there_is(recording, quick):
    calibration = Calibration(recording, "tigrillo", quick.replace(generations=50))
    fit = calibration.run(lambda generation: calibration.cancel())
    assert fit.ended == "cancelled"
    assert len(fit.history) == 1
    assert fit.error == min(fit.before, fit.history[0].best)


def test_nothing_better_than_the_default_body_gives_the_default_body(recording, quick):
    calibration = Calibration(recording, "tigrillo", quick)
    calibration.cancel()
    fit = calibration.run()
    assert fit.error <= fit.before
    if fit.error == fit.before:
        assert fit.values == parameter_set("seven").default


def test_an_interrupted_search_ends_like_one_that_was_left_alone(recording, quick, tmp_path):
    whole = Calibration(recording, "tigrillo", quick).run(folder=tmp_path / "a")
    first = Calibration(recording, "tigrillo", quick)
    first.run(lambda generation: first.cancel(), folder=tmp_path / "b")
    rest = Calibration(recording, "tigrillo", quick).run(folder=tmp_path / "b")
    assert (rest.values, rest.error) == (whole.values, whole.error)
    with pytest.raises(ParameterError, match="belongs to other work"):
        Calibration(recording, "tigrillo", quick.replace(loss="author")).run(folder=tmp_path / "b")


def test_a_search_starts_at_the_default_body_and_anew_elsewhere():
    seven = parameter_set("seven")
    for seed in (0, 1):
        np.testing.assert_allclose(start(seven, seed), seven.to_unit(seven.default))
    places = [start(seven, seed, run) for seed in (0, 1) for run in (1, 2)]
    assert len({tuple(place) for place in places}) == 4


def test_a_fit_is_plain_data():
    history = [Generation(i, 10 * i, 1.0 / i, 2.0, 0.1, {"a": 1.0}) for i in (1, 2)]
    fit = Fit(3, {"a": 1.0}, 0.5, 4.0, history, "done")
    again = fit_from_dict(json.loads(json.dumps(fit.to_dict())))
    assert again == fit
    assert again.ratio == 8.0


def test_the_plateau_is_where_the_curve_has_made_its_way():
    assert plateau([10.0, 5.0, 2.0, 1.0, 1.0]) == 3
    assert plateau([10.0, 1.0, 1.0, 1.0]) == 1
    assert plateau([1.0, 1.0]) == 0
