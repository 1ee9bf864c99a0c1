# SPDX-License-Identifier: Apache-2.0
"""The smallest visible size of each effect in given recordings, and effects that look alike.

An effect is visible if it changes a channel by more than what a search treats as noise. Only the
model and its commands are used; the measured signals of the robot have no influence.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np

from loco_control.exceptions import LocoError
from loco_sim.effects import EFFECTS

from ...jobs.pool import Jobs
from ..hypotheses.bundles import Batch
from ..hypotheses.hypotheses import Hypothesis
from ..prediction.case import Case

TRIES = 4  # sizes of an effect that are simulated
GROW, SHRINK = 30.0, 3e-3  # largest and smallest factor from one tried size to the next
RATIO, LEVEL = 5.0, 1.1  # sizes this factor apart with levels within this one: a flat response
LINEAR = 2.0  # factor from the target response within which the response is taken as linear
DEAD = 1e-6  # response over a visible one below which there is none
MIN_EXPONENT, STEEP = 0.3, 3.0  # bounds on the exponent of the response over the size (taste)
SAME = 0.95  # cosine of two responses above which these recordings cannot distinguish them
YES, LARGE, NO = "yes", "if large", "no"


@dataclass(frozen=True)
class Visible:
    """One strength of an effect at one place.

    Attributes:
        effect: Name of the effect.
        variant: Part of an effect with many, e.g. the signal of a sensor.
        place: Joint, link or foot; empty for the whole robot.
        parameter: Name of the strength.
        unit: Unit of the strength.
        smallest: Smallest visible size; infinite if no size is visible.
        typical: Typical size in robots with this effect.
        most: Size that nine of ten robots stay below.
        seen: `YES` if visible below the typical size, `LARGE` below the largest, else `NO`.
        channel: Channel with the largest response.
        alike: Other effects that change these recordings in the same way.
        failed: Reason why the robot cannot be built with it; empty if it can.
    """

    effect: str
    variant: str
    place: str
    parameter: str
    unit: str
    smallest: float
    typical: float
    most: float
    seen: str
    channel: str = ""
    alike: tuple[str, ...] = ()
    failed: str = ""


class _Size(NamedTuple):
    """A simulated size of a strength."""

    x: float  # coordinate
    level: float  # rms in the channel with the largest response, over that of a visible effect
    channel: int  # index of this channel
    column: np.ndarray  # change of all values [floors], (N,)

    @property
    def log(self) -> float:
        """Logarithm of the level: 0 for a just visible response."""
        return math.log(max(self.level, 1e-9))


@dataclass
class _Trial:
    """Search state of one strength of a hypothesis."""

    hypothesis: Hypothesis
    strength: int
    channels: np.ndarray | None  # channels of its branch, (C,) flags; None is all
    x: float
    best: _Size | None = None
    dead: float = 0.0  # largest size without a response
    loud: float = math.inf  # smallest visible size
    done: bool = False
    failed: str = ""

    def spec(self) -> dict[str, Any]:
        """Entry of a list of effects, with all other strengths 0."""
        at = [0.0 if c.strength else c.start[0] for c in self.hypothesis.coordinates]
        at[self.strength] = self.x
        return self.hypothesis.term(at).spec

    def take(self, response: np.ndarray, channel_of: np.ndarray, threshold: float) -> None:
        """Keep the response to this size if it is closest to a visible one; choose the next size.

        Args:
            response: Change of all values [floors], (N,).
            channel_of: Channel of each value, (N,).
            threshold: Rms in one channel above which an effect is visible [floors].
        """
        if self.done:
            return
        if self.channels is not None:
            response = np.where(self.channels[channel_of], response, 0.0)
        count = np.maximum(np.bincount(channel_of), 1)
        rms = np.sqrt(np.bincount(channel_of, np.square(response)) / count)
        channel = int(np.argmax(rms))
        level = float(rms[channel]) / threshold
        size = _Size(self.x, level, channel, response.astype(np.float32))
        power, constant = self._power(size), self._same(size, RATIO)
        if self._is_closer(size):
            self.best = size
        if level < DEAD:
            self.dead = max(self.dead, self.x)
        elif level > 1.0:
            self.loud = min(self.loud, self.x)
        x = self.x * min(max(max(level, 1e-9) ** (-1.0 / power), SHRINK), GROW)
        jump = 0.0 < self.dead < self.loud < math.inf  # no response below a threshold
        if jump and not self.dead < x < self.loud:
            x = math.sqrt(self.dead * self.loud)
        self.x = self.hypothesis.coordinates[self.strength].clipped(x)
        visible = 1.0 / LINEAR <= level <= LINEAR or (jump and self.loud <= LINEAR**2 * self.dead)
        self.done = visible or constant or self.x == size.x

    def _is_closer(self, size: _Size) -> bool:
        """Whether a size is nearer to a just visible one than the best; the smaller if alike."""
        if self._same(size) and size.level > 1.0:
            return size.x < self.best.x
        return self.best is None or abs(size.log) < abs(self.best.log)

    def _same(self, size: _Size, ratio: float = 1.0) -> bool:
        """Whether the response is that of the best size, `ratio` times as large or small.

        If they are far apart it has saturated, or there is none: further sizes change nothing.
        """
        best = self.best
        if best is None or size.x * best.x <= 0.0:
            return False
        distant = abs(math.log(size.x / best.x)) >= math.log(ratio)
        return distant and abs(size.log - best.log) < math.log(LEVEL)

    def _power(self, size: _Size) -> float:
        """Exponent of the response over the size, from this and the best earlier size."""
        best = self.best
        if best is None or size.x == best.x or min(size.level, best.level) < DEAD:
            return 1.0
        grown = math.log(size.level / best.level) / math.log(size.x / best.x)
        return min(max(grown, MIN_EXPONENT), STEEP)

    def smallest(self) -> float:
        """Smallest visible size, extrapolated linearly from the closest simulated one.

        The extrapolation to smaller sizes is limited to a factor of `LINEAR`.
        """
        c = self.hypothesis.coordinates[self.strength]
        if self.best is None or self.best.level < DEAD:
            return math.inf
        size = abs(c.origin + c.size * self.best.x / min(self.best.level, LINEAR))
        return math.inf if size > max(abs(c.low), abs(c.high)) else size


def visible_sizes(
    case: Case, batches: Sequence[Batch], threshold: float, tasks: Jobs,
    report: Callable[[float], None],
) -> tuple[list[Visible], float]:  # fmt: skip
    """Find the smallest visible size of every strength of every hypothesis.

    Args:
        case: Model and recordings.
        batches: Hypotheses that can be simulated together.
        threshold: Rms in one channel above which an effect is visible [floors].
        tasks: Pool of processes that run `fitting.search.call` with the case.
        report: Called with the share of the bundles that were simulated.

    Returns:
        A result for each strength, and the processor time of all simulations [s].
    """
    base, trials, seconds = case.vector((), coarse=True), [], 0.0
    jobs = [(_timed, (group, threshold, base)) for group in batches]
    for i, (result, duration) in enumerate(tasks.ordered(jobs), start=1):
        trials, seconds = trials + result, seconds + duration
        report(i / len(jobs))
    return _summarise(case, trials), seconds


def _timed(
    case: Case, batch: Batch, threshold: float, base: np.ndarray
) -> tuple[list[_Trial], float]:
    """Result of `try_bundle`, and its processor time [s]."""
    began = time.process_time()
    return try_bundle(case, batch, threshold, base), time.process_time() - began


def try_bundle(case: Case, batch: Batch, threshold: float, base: np.ndarray) -> list[_Trial]:
    """Responses of the recordings to each strength of some hypotheses.

    A hypothesis with which the robot cannot be built reports the reason. `base` is the prediction
    of the model as it is [floors], (N,).
    """
    channel_of, result = case.channel_of(), []
    for strength in batch.hypotheses[0].strengths:
        trials = [
            _Trial(h, strength, mask, h.starts()[0][strength])
            for h, mask in zip(batch.hypotheses, batch.channels, strict=True)
        ]
        for _ in range(TRIES):
            try:
                moved = case.vector([t.spec() for t in trials], coarse=True)
            except LocoError as error:
                if len(trials) > 1:  # simulate them one by one to find the invalid one
                    pairs = zip(batch.hypotheses, batch.channels, strict=True)
                    singles = [Batch((h,), (m,)) for h, m in pairs]
                    return [t for one in singles for t in try_bundle(case, one, threshold, base)]
                trials[0].failed = str(error)
                break
            for trial in trials:
                trial.take(moved - base, channel_of, threshold)
            if all(trial.done for trial in trials):
                break
        result += trials
    return result


def _summarise(case: Case, trials: Sequence[_Trial]) -> list[Visible]:
    """Results of the trials, with other effects of similar responses."""
    effects, rows = np.array([t.hypothesis.effect for t in trials]), []
    for trial, same in zip(trials, _same(trials), strict=True):
        h, c = trial.hypothesis, trial.hypothesis.coordinates[trial.strength]
        prior = EFFECTS[h.effect].identity.priors.get(c.name)
        typical, high = abs(c.size), abs(prior.high) if prior else math.inf
        typical = prior.typical if c.origin else typical
        smallest = trial.smallest()
        verdict = YES if smallest <= typical else LARGE if smallest <= high else NO
        channel, similar = "", set()
        if verdict != NO:
            channel = str(case.forward.channels[trial.best.channel])
            similar = {*effects[same].tolist()} - {h.effect}
        rows.append(
            Visible(h.effect, h.variant, h.place, c.label, c.unit, smallest, typical, high, verdict,
                    channel, tuple(sorted(similar)), trial.failed)
        )  # fmt: skip
    return rows


def _same(trials: Sequence[_Trial]) -> np.ndarray:
    """Flags of pairs of responses that are alike, (E, E); False where there is none."""
    live = [i for i, t in enumerate(trials) if t.best is not None and t.best.level >= DEAD]
    same = np.zeros((len(trials), len(trials)), dtype=bool)
    if live:
        responses = np.stack([trials[i].best.column for i in live])
        responses /= np.linalg.norm(responses, axis=1, keepdims=True)
        same[np.ix_(live, live)] = np.abs(responses @ responses.T) > SAME
    return same
