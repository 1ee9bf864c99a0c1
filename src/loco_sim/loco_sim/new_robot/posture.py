# SPDX-License-Identifier: Apache-2.0
"""Search for a standing posture: feet level, knees bent, centre of mass over the feet."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .. import lazy
from .body import Body
from .supports import Probe, Support

# Loaded on first use, since they take 0.4 s and bolted robots need neither.
optimize, spatial = lazy.module("scipy.optimize"), lazy.module("scipy.spatial")

STRETCH = (0.8, 0.7, 0.9, 0.6, 0.95, 0.5)  # hip-foot distance / leg length, tried in turn [-]
LEVEL = 0.004  # largest height difference of feet, share of the robot's size
STARTS = 4  # number of postures from which a descent starts
DRAWS = 300  # number of random postures from which starts are chosen
SOLE = 0.01  # points this close above the lowest one touch the ground, share of the size
CENTRED = 0.02  # largest distance of centre of mass and centre of the feet, share of the size


@dataclass(frozen=True)
class Posture:
    """A posture in which a robot stands.

    Attributes:
        q: Joint positions [rad or m], (n,).
        height: Height of the base over the ground [m].
        soles: Contact points of each support, base frame [m], (k, 3) each.
        margin: Distance of the centre of mass to the border of the polygon of the feet
            [m]; negative outside.
        stretch: Hip-foot distance / its maximum [-]; 1 without legs.
        uneven: Largest difference in height between feet [m].
    """

    q: np.ndarray
    height: float
    soles: list[np.ndarray]
    margin: float
    stretch: float
    uneven: float

    @property
    def feet(self) -> np.ndarray:
        """Middle of each sole in the base frame [m], (m, 3)."""
        return np.array([sole.mean(axis=0) for sole in self.soles])


class Search:
    """Search for a posture of the legs of a robot; wheels are not moved.

    Args:
        probe: The robot.
        supports: Feet and wheels of the robot.
        q: Positions of all other joints, (n,).
        rng: Random generator of initial postures.
    """

    def __init__(
        self,
        probe: Probe,
        supports: list[Support],
        q: np.ndarray,
        rng: np.random.Generator,
    ):
        self._probe, self._supports, self._q0, self._rng = probe, supports, q, rng
        self._body: Body = probe.body
        self._size = probe.size(q)
        self._points = probe.points
        self._legs = [s for s in supports if _joints_of(s) and not (s.wheel and len(s.chain) < 3)]
        self._chains = [_joints_of(s) for s in self._legs]
        turn, place = self._body.forward(q)
        self._hips = [place[chain[0]] for chain in self._chains]
        self._level_feet = len(supports) == 2
        self._upright = {s.body: turn[s.body] for s in supports}
        lowest = probe.by_body(q)
        self._plane = [
            lowest[s.body][0][1] if abs(lowest[s.body][0][1] - hip[1]) < 0.5 * (s.depth + hip[2])
            else hip[1]
            for s, hip in zip(self._legs, self._hips, strict=True)
        ]  # fmt: skip

    def find(self) -> Posture:
        """The first posture with level feet, or the most level one."""
        if not self._legs:
            return self._posture(self._q0, 1.0)
        draws, postures = self._draw(), []
        for stretch in STRETCH:
            postures.append(self._centred(stretch, draws))
            if postures[-1].uneven < LEVEL * self._size and postures[-1].margin > 0.0:
                return postures[-1]
        return min(postures, key=lambda p: (p.margin <= 0.0, p.uneven))

    def _draw(self) -> list[np.ndarray]:
        """Random postures within the ranges of the leg joints, the nominal one first."""
        dofs = [j for chain in self._chains for j in chain]
        low = np.maximum(np.where(np.isfinite(self._body.low), self._body.low, -2.5), -3.0)[dofs]
        high = np.minimum(np.where(np.isfinite(self._body.high), self._body.high, 2.5), 3.0)[dofs]
        draws = [self._q0]
        for _ in range(DRAWS):
            q = self._q0.copy()
            q[dofs] = low + (high - low) * self._rng.random(len(dofs))
            draws.append(q)
        return draws

    def _centred(self, stretch: float, draws: list[np.ndarray]) -> Posture:
        """Posture with the feet shifted until the centre of mass is over their centre."""
        lengths = [s.depth + hip[2] for s, hip in zip(self._legs, self._hips, strict=True)]
        ground = max(
            hip[2] - stretch * reach for hip, reach in zip(self._hips, lengths, strict=True)
        )
        shift, start = np.zeros(2), None
        for _ in range(3):
            q = self._q0.copy()
            for i, chain in enumerate(self._chains):
                goal = np.array([self._hips[i][0] + shift[0], self._plane[i] + shift[1], ground])
                first = [start] if start is not None else self._best(i, goal, lengths[i], draws)
                q[list(chain)] = self._solve(i, goal, lengths[i], first)
            posture, start = self._posture(q, stretch), q
            offset = self._body.centre(q)[:2] - posture.feet[:, :2].mean(axis=0)
            if np.abs(offset).max() < CENTRED * self._size:
                break
            shift = np.clip(shift + offset, -0.3 * min(lengths), 0.3 * min(lengths))
        return posture

    def _best(self, i: int, goal: np.ndarray, reach: float, draws: list) -> list[np.ndarray]:
        return sorted(draws, key=lambda q: self._cost(q, i, goal, reach))[:STARTS]

    def _solve(self, i: int, goal: np.ndarray, reach: float, starts: list) -> np.ndarray:
        """Joint positions of leg i, best result of descents from several postures."""
        chain = list(self._chains[i])
        pose = starts[0].copy()

        def cost(x: np.ndarray) -> float:
            pose[chain] = x
            return self._cost(pose, i, goal, reach)

        results = []
        options = {"xatol": 1e-5, "fatol": 1e-9, "maxfev": 150 * len(chain)}
        for x in (start[chain] for start in starts):
            simplex = x + 0.1 * np.vstack([np.zeros(len(chain)), np.eye(len(chain))])
            options["initial_simplex"] = simplex
            results.append(optimize.minimize(cost, x, method="Nelder-Mead", options=options))
        return min(results, key=lambda end: end.fun).x

    def _cost(self, q: np.ndarray, i: int, goal: np.ndarray, reach: float) -> float:
        """Cost of leg i: distance of the foot from its goal, and penalty of unnatural postures."""
        body, support, chain = self._body, self._legs[i], self._chains[i]
        lowest = self._probe.by_body(q)
        foot = np.array(lowest[support.body][0])
        error = (foot - goal) / reach
        cost = 1e4 * error[2] ** 2 + 30.0 * error[0] ** 2 + 30.0 * error[1] ** 2
        lower, upper = body.low[list(chain)], body.high[list(chain)]
        x = q[list(chain)]
        margin = 0.05 * np.where(np.isfinite(upper - lower), upper - lower, 0.0)
        excess = np.maximum(0.0, np.maximum(lower + margin - x, x - upper + margin))
        cost += 1e3 * float(excess @ excess)
        for k in chain[:-1]:  # knees and hips must be above the ground
            if k in lowest:
                cost += 1e3 * max(0.0, (goal[2] + 0.05 * reach - lowest[k][0][2]) / reach) ** 2
        turn, place = body.forward(q)
        knee = (place[chain[-1]] - self._hips[i]) / reach
        cost += 0.3 * knee[0] + 3.0 * knee[1] ** 2  # prefer knees behind the hips, in their plane
        cost += 0.02 * float(np.sum((x - self._q0[list(chain)]) ** 2))
        if self._level_feet:
            tilt = turn[support.body] @ self._upright[support.body].T - np.eye(3)
            cost += 30.0 * float(np.sum(tilt**2))
        return cost

    def _posture(self, q: np.ndarray, stretch: float) -> Posture:
        lowest = self._probe.by_body(q)
        bottoms = np.array([lowest[s.body][0][2] for s in self._supports])
        turn, place = self._body.forward(q)
        soles = []
        for support, bottom in zip(self._supports, bottoms, strict=True):
            points = place[support.body] + self._points[support.body] @ turn[support.body].T
            sole = points[points[:, 2] < bottom + SOLE * self._size]
            soles.append(sole if len(sole) else np.array([lowest[support.body][0]]))
        com = self._body.centre(q)[:2]
        margin = inside(np.vstack(soles)[:, :2], com)
        return Posture(
            q.copy(), -float(bottoms.min()), soles, margin, stretch, float(np.ptp(bottoms))
        )


def _joints_of(support: Support) -> tuple[int, ...]:
    """Joints of a support that a posture may bend."""
    return support.chain[:-1] if support.wheel else support.chain


def inside(points: np.ndarray, point: np.ndarray) -> float:
    """Distance of a point to the border of the convex hull of others, negative outside [m].

    Args:
        points: Corners, (k, 2).
        point: The point, (2,).
    """
    try:
        hull = spatial.ConvexHull(points)
    except (spatial.QhullError, ValueError):  # fewer than three points, or all on one line
        return -float(np.min(np.linalg.norm(points - point, axis=1)))
    return -float(np.max(hull.equations[:, :2] @ point + hull.equations[:, 2]))
