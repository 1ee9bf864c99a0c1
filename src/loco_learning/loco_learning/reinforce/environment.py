# SPDX-License-Identifier: Apache-2.0
"""An experiment as a Gymnasium environment, for any reinforcement learning library.

It runs in this process, or in processes of Gymnasium:

    env = ReflexEnv("tigrillo_bound_reflex", "weights.npz")
    gymnasium.vector.AsyncVectorEnv([functools.partial(ReflexEnv, ...)] * 4)   # in processes
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from loco_control.exceptions import DivergedError, MissingPackageError, NameUnknownError

from ..runs.experiment import Experiment, load
from ..runs.rollout import build
from .episode import checked, prepared
from .guided import GuidedNetwork
from .params import ReinforceParams
from .reward import Reward

try:
    import gymnasium
    from gymnasium import spaces
except ModuleNotFoundError as error:
    raise MissingPackageError(
        f"{error.name} is not installed; it comes with `./loco install rl`"
    ) from None

OBSERVED = ("hidden", "senses")


class ReflexEnv(gymnasium.Env):
    """A robot driven by a readout plus the actions of an agent.

    ===========  =====================================================================
    observation  ``hidden``: activity u of the network's hidden layer, (N,), the input of
                 the readout; ``senses``: its delay line, (M size,), newest first
    action       correction of each position that the network moves, in units of `reach`,
                 (k,) in [-1, 1]; with a readout of zeros it is the joint command itself
    reward       `Reward.tick` of the state after the action; a fall costs
                 `RewardParams.fall` times the ticks of an episode
    terminated   the robot fell, or the physics diverged; ``info["fall"]`` is the reason
    truncated    `ReinforceParams.episode` is over
    ===========  =====================================================================

    Each reset restarts the robot; it stands, then the target leads into the gait. Zero
    actions give the rollout of the same experiment and seed, bit by bit.

    Args:
        experiment: Experiment, its name or path; it must have a reflex network.
        weights: Weight file of its readout; see `episode.first_weights` for one of zeros.
        params: Lengths, push and reward; settings of the policy gradient are ignored.
        observe: Observation, one of `OBSERVED`.
        reach: Largest correction [rad].

    Attributes:
        seconds: Simulated time of all episodes, including standing and lead [s].

    Raises:
        LocoError: The experiment has no network, or the weights are of another network.
        NameUnknownError: The observation does not exist.
    """

    metadata = {"render_modes": []}  # noqa: RUF012, required by Gymnasium

    def __init__(
        self,
        experiment: Experiment | str,
        weights: str | Path,
        params: ReinforceParams | None = None,
        observe: str = "hidden",
        reach: float = 0.2,
    ):
        if observe not in OBSERVED:
            raise NameUnknownError("observation", observe, OBSERVED)
        loaded = load(experiment) if isinstance(experiment, str) else experiment
        self.params, self._observe, self.reach = params or ReinforceParams(), observe, reach
        self.experiment = e = prepared(checked(loaded), self.params, weights)
        self._reward = Reward(self.params.reward, e.plant, e.sim_params)
        self._ticks = round(self.params.episode / e.dt)
        self._lead = e.ticks - self._ticks
        self._loop = build(e, network=GuidedNetwork)
        network = self._loop.reflex
        size = {"hidden": network.readout.neurons, "senses": network.delay_line.length
                * network.delay_line.size}[observe]  # fmt: skip
        bounded = observe == "hidden" and e.learner.activation == "tanh"
        bound = 1.0 if bounded else np.inf
        self.observation_space = spaces.Box(-bound, bound, (size,), np.float64)
        self.action_space = spaces.Box(-1.0, 1.0, (len(network.outputs),), np.float64)
        self._fall_reason, self._done, self.seconds = "", 0, 0.0

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[np.ndarray, dict[str, Any]]:
        """Restart the robot and lead it into the gait; the seed determines all that follows."""
        super().reset(seed=seed)
        self._loop.reset(int(self.np_random.integers(2**31)) if seed is None else seed)
        self._fall_reason, self._done = "", 0
        for _ in range(self._lead):
            self._tick()
        return self._sensed(), {"fall": self._fall_reason}

    def step(
        self, action: np.ndarray
    ) -> tuple[np.ndarray, float, bool, bool, dict[str, Any]]:  # fmt: skip
        """One control period with an action (k,); see the class."""
        correction = self.reach * np.clip(action, -1.0, 1.0)
        self._loop.reflex.correction[:] = correction
        self._tick()
        self._done += 1
        state, ground_truth = self._loop.state, self._loop.sim.ground_truth()
        reward = float(self._reward.tick(ground_truth.linear_velocity, state.dq, state.tau))
        if self._fall_reason:
            reward = -self.params.reward.fall * self._ticks
        over = self._done >= self._ticks
        return self._sensed(), reward, bool(self._fall_reason), over, {"fall": self._fall_reason}

    def close(self) -> None:
        """Free the plant."""
        self._loop.close()

    def _tick(self) -> None:
        if self._fall_reason:
            return
        try:
            self._loop.step()
            self.seconds += self.experiment.dt
            self._fall_reason = self._loop.sim.fallen or ""
        except DivergedError as error:
            self._fall_reason = str(error)

    def _sensed(self) -> np.ndarray:
        """Observation of the current state."""
        network: Any = self._loop.reflex
        if not self._fall_reason:
            network.sense(self._loop.feel(self._loop.state))
        return (network.activity if self._observe == "hidden" else network.line.reshape(-1)).copy()
