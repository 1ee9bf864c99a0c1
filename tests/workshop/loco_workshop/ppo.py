# SPDX-License-Identifier: Apache-2.0
"""PPO of stable-baselines3 on the readout of a reflex, for `loco reinforce contest`.

Its policy is linear in the hidden activity and has no bias, so that the learned policy is a
readout. It also explores by perturbing the readout (gSDE), with a new draw every
`HOLD` ticks. Source: Schulman et al., 2017; Raffin et al., CoRL 2021.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from loco_control.exceptions import MissingPackageError, ParameterError
from loco_learning.reflex import weights as weight_files
from loco_learning.reinforce.environment import ReflexEnv
from loco_learning.reinforce.episode import kind
from loco_learning.reinforce.params import ReinforceParams
from loco_learning.runs.experiment import Experiment

try:
    import stable_baselines3
    import torch
except ModuleNotFoundError as error:
    raise MissingPackageError(
        f"{error.name} is not installed; it comes with `./loco install ppo`"
    ) from None

REACH = 0.8  # largest action [rad]: the range of the hips in a gait search (theory)
HOLD = 50  # ticks with one perturbation, half a stride of Tigrillo (taste)
TICKS = 1000  # per update (taste: two updates per twenty seconds)
# Initial standard deviation of an action. With three times the range of the hips the policy of
# Tigrillo diverged, to commands of 5 rad, and the robot lay still (battery).
SPREAD = 0.3


class _Budget(stable_baselines3.common.callbacks.BaseCallback):
    """Ends the learning when the budget of simulated time is spent, and reports progress."""

    def __init__(self, env: ReflexEnv, seconds: float, report: Callable[[float], Any] | None):
        super().__init__()
        self._env, self._seconds, self._report = env, seconds, report

    def _on_step(self) -> bool:
        if self._report and self.n_calls % 100 == 0:
            self._report(self._env.seconds)
        return self._env.seconds < self._seconds


def learn_by_ppo(
    experiment: Experiment,
    params: ReinforceParams,
    start: str | Path,
    report: Callable[[float], Any] | None = None,
) -> tuple[np.ndarray, float]:
    """Learn a correction of the readout in a file within the budget of simulated time.

    Args:
        experiment: Experiment with a reflex network.
        params: Budget, seed, lengths and reward; settings of the policy gradient are ignored.
        start: Weight file, perhaps of zeros.
        report: Called every 100 steps with the simulated time [s].

    Returns:
        Readout (N, 2k) and the simulated time [s].

    Raises:
        ParameterError: The budget is too small for one update.
    """
    length = experiment.learner.stand + params.lead + params.episode
    min_time = length * (1.0 + TICKS * experiment.dt / params.episode)  # plus the first reset
    if params.seconds < min_time:
        raise ParameterError(
            f"seconds is {params.seconds:g}, but PPO needs {min_time:.4g} s for one update of "
            f"{TICKS} ticks; give more, or longer episodes"
        )
    torch.set_num_threads(1)  # the same bytes on every machine, and no slower
    env = ReflexEnv(experiment, start, params, "hidden", REACH)
    loudness = np.linalg.norm(env.reset(seed=params.seed)[0])  # norm of u, to which actions scale
    log_std = float(np.log(SPREAD / loudness))
    model = stable_baselines3.PPO(
        "MlpPolicy",
        env,
        n_steps=TICKS,
        batch_size=TICKS // 4,
        use_sde=True,
        sde_sample_freq=HOLD,
        policy_kwargs={"net_arch": {"pi": [], "vf": [64, 64]}, "log_std_init": log_std},
        seed=params.seed,
        device="cpu",
    )
    layer = model.policy.action_net
    with torch.no_grad():
        layer.weight.zero_()
        layer.bias.zero_()
    layer.bias.requires_grad_(False)
    try:
        model.learn(10**9, callback=_Budget(env, params.seconds, report))
    finally:
        env.close()
    readout = weight_files.read_readout(start, kind(experiment))
    learnt = layer.weight.detach().numpy().astype(float).T  # (N, k)
    readout[:, : learnt.shape[1]] += REACH * learnt
    return readout, env.seconds
