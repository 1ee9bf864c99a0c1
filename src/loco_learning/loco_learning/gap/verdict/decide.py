# SPDX-License-Identifier: Apache-2.0
"""Rules of the verdict: named, ambiguous, unknown or no gap, with one sentence of evidence each.

An effect is named when all of this holds on held-out data: without it the model is worse beyond
chance, every rival of another name is improbable, its parameters are physical and exclude "absent",
most blocks agree, and it closes a good share of the gap.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from loco_control.params import Params, parameter
from loco_sim.effects import EFFECTS

from ..statistics import evidence
from ..statistics.evidence import Score
from .candidates import Candidate, Estimate, Rival, on_bound
from .leftover import adequate, explained

NAMED, AMBIGUOUS, UNKNOWN, NO_GAP = "named", "ambiguous", "unknown", "no gap"
MORE = "named, and more is missing"


@dataclass(frozen=True)
class Limits(Params):
    """Conditions for naming an effect."""

    # The only criterion for "the model explains the data": it decides whether there is a gap,
    # whether a search starts and ends, which effects are visible, and whether more is missing.
    # Battery: residual of a true model from noise, jitter of stamps and the other integrator.
    explained: float = parameter(
        1.25, "rms of a channel [floors], beyond chance, up to which a model explains it", low=1.0
    )
    # A different criterion: small differences between models are distinguished from noise only if
    # one of them has little more than this residual in all data together (battery).
    noise: float = parameter(
        1.5, "rms on all data [floors] up to which what a model leaves says how large noise is",
        low=1.0,
    )  # fmt: skip
    odds: float = parameter(10.0, "smallest odds against every rival of another name", low=1.0)
    worse: float = parameter(3.0, "rms over the best model's beyond which it is no rival", low=1.0)
    blocks: float = parameter(2.0 / 3.0, "smallest share of improved blocks", low=0.0, high=1.0)
    # Shares of the gap are those of the rms above noise (`evidence.closed_by`).
    closed: float = parameter(0.163, "smallest share of the gap that an effect closes", high=1.0)
    # No model of real hardware reduces a large gap to noise (taste).
    most: float = parameter(
        0.9, "share of a channel's gap in a record whose closing is as good as explaining it",
        high=1.0,
    )  # fmt: skip
    large: float = parameter(
        0.5, "share of the gap that established effects must close to be named while more is "
        "missing", low=0.0, high=1.0
    )  # fmt: skip
    aside: float = parameter(
        0.1, "share of the whole gap that may be in channels that the model leaves alone", high=1.0
    )  # fmt: skip
    alone: float = parameter(
        3.0, "rms of a channel [floors] on all records up to which the model may leave it alone "
        "(battery 10606)", low=1.0
    )  # fmt: skip
    spread: float = parameter(
        0.3, "deviation of a strength between parts of the data, over its value, from which on "
        "it is no constant of the robot", low=0.0
    )  # fmt: skip
    imitated: float = parameter(
        0.9, "cosine of an effect with what refitted nominal values can make, from which on it is "
        "not told from one of them that is strained", low=0.0, high=1.0
    )  # fmt: skip
    strained: float = parameter(
        2.0, "deviations of its prior that a nominal value may be from what the robot says", low=0.0
    )
    trifle: float = parameter(
        3.0, "rms of the loudest channel [floors] on all records up to which a gap that something "
        "too small to matter explains is none", low=1.0
    )  # fmt: skip
    edge: float = parameter(
        0.01, "distance from a bound, over the value, that counts as on it", low=0.0, high=0.5
    )


LIMITS = Limits()


@dataclass(frozen=True)
class Ruling:
    """Verdict on one candidate.

    Attributes:
        name: Name of the effect.
        place: Place of the effect.
        verdict: `NAMED`, `AMBIGUOUS` or `UNKNOWN`.
        odds: Odds against the best rival of another name; if there is none, against its absence.
        look_alikes: Names that cannot be excluded.
        places: Other places of the same effect that cannot be excluded.
        alarms: Reasons why its parameters are implausible, a sentence each.
        evidence: Evidence in one sentence.
    """

    name: str
    place: str
    verdict: str
    odds: float
    look_alikes: tuple[str, ...]
    places: tuple[str, ...]
    alarms: tuple[str, ...]
    evidence: str


@dataclass(frozen=True)
class Decision:
    """The verdict.

    Attributes:
        verdict: `NAMED`, `MORE`, `AMBIGUOUS`, `UNKNOWN` or `NO_GAP`.
        rulings: One per candidate, in the order of the candidates.
        adequate: Whether the model explains the data.
        evidence: Evidence in one sentence.
    """

    verdict: str
    rulings: tuple[Ruling, ...]
    adequate: bool
    evidence: str

    @property
    def names(self) -> tuple[str, ...]:
        """Named effects, sorted; empty if the verdict is unknown."""
        return () if self.verdict == UNKNOWN else _names(self.rulings, NAMED)

    @property
    def ambiguous(self) -> tuple[tuple[str, ...], ...]:
        """Groups of names among which the data cannot distinguish."""
        return _groups(self.rulings)

    @property
    def alarms(self) -> tuple[str, ...]:
        """Implausible parameters of all candidates, a sentence each."""
        return tuple(alarm for r in self.rulings for alarm in r.alarms)


def has_gap(before: Sequence[np.ndarray], limits: Limits = LIMITS) -> bool:
    """True if some channel's residual is above its floor by more than chance.

    Args:
        before: Whitened residuals of the initial model on all records, (T, C) each.
        limits: Conditions for naming an effect, of which `explained` is used.
    """
    return not explained(before, limits).all()


def decide(
    candidates: Sequence[Candidate],
    before: Score,
    after: Score,
    limits: Limits = LIMITS,
    whole: tuple[Sequence[np.ndarray], Sequence[np.ndarray]] | None = None,
    enough: np.ndarray | None = None,
    gap: bool | None = None,
) -> Decision:
    """Decide on the cause of the gap.

    Args:
        candidates: Terms of the selected model; none if nothing was selected.
        before: Score of the user's own model on held-out data.
        after: Score of the selected model on held-out data.
        limits: Conditions for naming an effect.
        whole: Residuals of both on all records, including the fitted ones, which the model must
            explain too.
        enough: Rms over all records [floors] up to which a channel counts as explained, (C,).
        gap: Whether there is a gap; by default judged from the residuals of the user's model.
    """
    residuals = whole or (before.residuals, after.residuals)
    if not (has_gap(residuals[0], limits) if gap is None else gap):
        text = f"The model explains the data: {before.rms:.2f} noise floors."
        return Decision(NO_GAP, (), True, text)
    assessments = tuple(_rule(c, limits) for c in candidates)
    closed = evidence.closed_by(before.residuals, after.residuals)
    explains = adequate(*residuals, limits, enough)
    if explains and _trifling(
        candidates, float(np.nanmax(evidence.by_channel(residuals[0]))), limits
    ):
        text = (
            f"The model is {before.rms:.2f} noise floors off only because it is sensitive there: "
            f"{candidates[0].name} too small to matter explains it."
        )
        return Decision(NO_GAP, (), True, text)
    verdict = _overall(assessments, explains, large(residuals, before, after, limits))
    loud = None if explains else float(np.nanmax(evidence.by_channel(residuals[1])))
    text = _summary(verdict, assessments, loud, before.rms, after.rms, closed)
    return Decision(verdict, assessments, explains, text)


def _names(rulings: Sequence[Ruling], verdict: str) -> tuple[str, ...]:
    return tuple(sorted({r.name for r in rulings if r.verdict == verdict}))


def _groups(rulings: Sequence[Ruling]) -> tuple[tuple[str, ...], ...]:
    ambiguous = [r for r in rulings if r.verdict == AMBIGUOUS]
    return tuple(sorted({tuple(sorted({r.name, *r.look_alikes})) for r in ambiguous}))


def _trifling(candidates: Sequence[Candidate], rms: float, limits: Limits) -> bool:
    """True if the gap is small and negligible changes explain it as well as anything else."""
    small = [
        c.trifle or any(r.trifle and r.over.odds <= limits.odds for r in c.rivals)
        for c in candidates
    ]
    return bool(small) and all(small) and rms <= limits.trifle


def alarms(candidate: Candidate, limits: Limits = LIMITS) -> tuple[str, ...]:
    """Implausible parameters of a candidate, with the reason, one line each."""
    messages, open_ends = [], _undetermined(candidate.estimates)
    for e in candidate.estimates:
        where = f"{candidate.name} {candidate.place}".strip() + f": {e.name} = {e.value:.3g}"
        where = f"{where} {e.unit}" if e.unit != "-" else where
        if _on_bound(e, limits.edge):
            messages.append(f"{where} is on the bound of its range {e.least:g} to {e.most:g}")
        if e.sign * e.value < 0.0:
            kind = "negative" if e.value < 0.0 else "positive"
            messages.append(f"{where} is {kind}, which is not physical")
        if e in open_ends:
            messages.append(f"{where} has no interval: the data do not determine it")
        if e.absent is not None and e.spread > limits.spread * _size(e, candidate.estimates):
            messages.append(f"{where} differs by {e.spread:.2g} between parts of the data")
    return tuple(messages)


def _size(one: Estimate, estimates: Sequence[Estimate]) -> float:
    """Largest distance from absence of strengths in its unit: a vector may have components of 0."""
    same_unit = (e for e in estimates if e.absent is not None and e.unit == one.unit)
    return max(abs(e.value - e.absent) for e in same_unit)


def _undetermined(estimates: Sequence[Estimate]) -> list[Estimate]:
    """Parameters without a finite interval, if no strength is determined; otherwise none.

    A stop that is too stiff to be determined has a smallest size: its interval has no upper end.

    A force along one axis of a hinge has two components without effect; a stop that is hardly
    touched has an undetermined damping. Only the strength of the effect must be determined.
    """
    open_ends = [e for e in estimates if not (math.isfinite(e.low) and math.isfinite(e.high))]
    candidates = [e for e in open_ends if e.absent is None or e.low <= e.absent <= e.high]
    determined = any(e.absent is not None and e not in candidates for e in estimates)
    return [] if determined else candidates


def _rule(c: Candidate, limits: Limits) -> Ruling:
    messages = alarms(c, limits)
    c = replace(c, rivals=serious(c, limits))
    close = [r for r in c.rivals if r.over.odds <= limits.odds]
    names = {r.name for r in close} - {c.name}
    inseparable = EFFECTS[c.name].identity.twins if c.name in EFFECTS else ()
    alternatives = tuple(sorted({*names, *inseparable, *c.traded}))
    locations = tuple(sorted({r.place for r in close if r.name == c.name and r.place != c.place}))
    deficits = lacks(c, messages, limits)
    verdict = UNKNOWN if deficits else AMBIGUOUS if alternatives else NAMED
    named_else = [r for r in c.rivals if r.name != c.name]
    odds = min((r.over.odds for r in named_else), default=c.gain.odds)
    odds = min(odds, 1.0) if inseparable else odds
    text = _sentence(c, verdict, deficits, alternatives, locations)
    return Ruling(c.name, c.place, verdict, odds, alternatives, locations, messages, text)


def serious(c: Candidate, limits: Limits) -> tuple[Rival, ...]:
    """Rivals with a similar residual that could be named themselves."""
    return tuple(
        r
        for r in c.rivals
        if r.worse <= limits.worse and not r.closed < limits.closed and not r.edge
    )


def lacks(c: Candidate, found: Sequence[str] = (), limits: Limits = LIMITS) -> list[str]:
    """Reasons against naming a candidate, a sentence each.

    Args:
        c: Candidate with its evidence on held-out data.
        found: Implausible parameters of the candidate.
        limits: Conditions for naming an effect.
    """
    deficits = []
    significant = c.worse > limits.worse or c.total is not None and c.total.low > 0.0
    if not (c.gain.low > 0.0 or c.gain.gain > 0.0 and significant):
        deficits.append(f"the gain of {c.gain.gain:.3g} nat may be chance (from {c.gain.low:.3g})")
    if c.gain.blocks_improved < limits.blocks:
        deficits.append(f"only {c.gain.blocks_improved:.0%} of the blocks improve")
    if c.closed < limits.closed:
        deficits.append(f"it closes only {c.closed:.0%} of the gap")
    strengths = [e for e in c.estimates if e.absent is not None]
    if strengths and not any(e.excludes_absent for e in strengths):
        deficits.append(f"the interval of {strengths[0].name} does not exclude that it is absent")
    return deficits + [alarm.split(": ", 1)[1] for alarm in found]


def _sentence(
    c: Candidate, verdict: str, wanting: list[str], others: Sequence[str], places: Sequence[str]
) -> str:
    what = f"{c.name} {c.place}".strip()
    if verdict == UNKNOWN:
        return f"{what} is not established: {'; '.join(wanting)}."
    data = "likelihood of all records" if c.elsewhere else "held-out likelihood"
    text = (
        f"without {what} the {data} falls by {c.gain.gain:.3g} nat (95 % interval "
        f"{c.gain.low:.3g} to {c.gain.high:.3g}), in {c.gain.blocks_improved:.0%} of the blocks; "
        f"it closes {c.closed:.0%} of the gap"
    )
    ranked = sorted((r for r in c.rivals if r.name != c.name), key=lambda r: r.over.odds)
    if verdict == AMBIGUOUS:
        odds_of_others = [r.over.odds for r in ranked if r.name in others]
        odds = f" (odds {odds_of_others[0]:.2g} to 1)" if odds_of_others and not c.traded else ""
        text += f"; {' and '.join(others)} cannot be excluded{odds}"
    elif ranked:
        text += f"; odds {ranked[0].over.odds:.2g} to 1 against the next name, {ranked[0].name}"
    if places:
        text += f"; it may also sit at {', '.join(places)}"
    for e in c.estimates:
        if e.excludes_absent and e.low <= e.absent <= e.high:
            size = f"{e.value:.3g} ± {e.with_shapes:.2g}" + f" {e.unit}" * (e.unit != "-")
            text += f"; {e.name} is known only together with its other values: {size} with these"
    return text[0].upper() + text[1:] + "."


def large(
    whole: tuple[Sequence[np.ndarray], Sequence[np.ndarray]],
    before: Score,
    after: Score,
    limits: Limits,
) -> bool:
    """True if a large share of the gap is closed, on all data and on held-out data.

    Args:
        whole: Residuals of the reference model and of the selected model on all records.
        before: Score of the user's own model on held-out data.
        after: Score of the selected model on held-out data.
        limits: Conditions for naming an effect.
    """
    pairs = whole, (before.residuals, after.residuals)
    return all(evidence.closed_by(*pair) >= limits.large for pair in pairs)


def _overall(rulings: Sequence[Ruling], adequate: bool, much: bool) -> str:
    """Overall verdict: unknown if the model neither explains the data nor closes much of the gap.

    A model that explains the data only with an effect that is not established is not established
    either: five of six such names in 400 cases of the blind battery were wrong or incomplete.
    """
    verdicts = {r.verdict for r in rulings}
    if adequate and AMBIGUOUS in verdicts:
        return AMBIGUOUS
    if verdicts == {NAMED}:
        return NAMED if adequate else MORE if much else UNKNOWN
    if verdicts == {NAMED, AMBIGUOUS} or verdicts == {AMBIGUOUS}:
        return AMBIGUOUS if much else UNKNOWN
    return UNKNOWN


def _summary(
    verdict: str,
    rulings: Sequence[Ruling],
    loud: float | None,
    before: float,
    after: float,
    closed: float,
) -> str:
    """Sentence on the verdict; `loud` is the largest unexplained rms of a channel [floors]."""
    names = " and ".join(_names(rulings, NAMED))
    groups = ["{" + ", ".join(group) + "}" for group in _groups(rulings)]
    gap = f"the gap falls from {before:.3g} to {after:.3g} noise floors ({closed:.0%} closed)"
    rest = "" if loud is None else f"; more is missing: {loud:.3g} are left where most is"
    if verdict in (NAMED, MORE):
        return f"With {names} {gap}{rest}."
    if verdict == AMBIGUOUS:
        return f"The data cannot tell {'; '.join(groups)} apart; {gap}{rest}."
    if loud is None and names:
        unknown = " and ".join(_names(rulings, UNKNOWN))
        return f"With {names} {gap}, but only beside {unknown}, which the data do not establish."
    best = " and ".join(filter(None, [names, *groups]))
    if not after < before:
        return f"No known effect explains the gap of {before:.3g} noise floors, or lowers it."
    part = f"{best} would close part of it, to" if best else "the best try leaves"
    return f"No known effect explains the gap of {before:.3g} noise floors; {part} {after:.3g}."


def _on_bound(e: Estimate, edge: float) -> bool:
    """True if on a bound other than "absent", where the interval decides."""
    return on_bound(e.value, (b for b in (e.least, e.most) if b != e.absent), edge)
