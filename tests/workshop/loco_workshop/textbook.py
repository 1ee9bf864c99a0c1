# SPDX-License-Identifier: Apache-2.0
"""Mass-spring networks in plain NumPy: the reference for tests and benchmarks."""

from __future__ import annotations

import numpy as np

from loco_sim.msd.network import Network
from loco_sim.msd.params import MsdParams
from loco_sim.msd.simulation import Drive


class TextbookSimulation:
    """One network without noise; arguments as in `MsdSimulation`."""

    def __init__(self, network: Network, params: MsdParams, drive: Drive):
        self.network, self.params, self.drive = network, params, drive
        self.stiffness = network.stiffness if drive.stiffness is None else drive.stiffness
        self.tick = 0
        self.position = network.positions.copy()
        self.velocity = np.zeros_like(self.position)
        self.acceleration = np.zeros_like(self.position)
        self.incidence = np.zeros((network.nodes, network.count))  # +1 at the first node of a link
        self.incidence[network.links[:, 0], np.arange(network.count)] = 1.0
        self.incidence[network.links[:, 1], np.arange(network.count)] = -1.0
        if params.integrator == "verlet":
            self.acceleration = self.forces(self.velocity) / network.masses[:, None]

    def forces(self, velocity: np.ndarray) -> np.ndarray:
        """Forces on the nodes [N], (nodes, axes), eqs. (4.2) to (4.7), for node velocities."""
        n, p, d = self.network, self.params, self.drive
        start, end = n.links.T
        span = self.position[end] - self.position[start]
        flow = velocity[end] - velocity[start]
        length = np.linalg.norm(span, axis=1)
        angle = 2.0 * np.pi * d.frequency * self.tick * p.step + d.phase
        driven = n.rest * (1.0 + d.amplitude * np.sin(angle))
        stretch = length - driven
        pull = self.stiffness * (stretch + p.nonlinearity / n.rest**2 * stretch**3)
        link = (pull / length)[:, None] * span
        if p.damper == "along_link":
            closing = np.sum(flow * span, axis=1) / length
            link += (n.damping * closing / length)[:, None] * span
        else:
            link += n.damping[:, None] * flow
        force = self.incidence @ link - p.drag * velocity
        force[:, -1] -= n.masses * p.gravity
        return force

    def step(self) -> None:
        """Advance one step of velocity Verlet with ground contact."""
        h, ground = self.params.step, self.params.ground
        moved = self.position + h * self.velocity + 0.5 * h * h * self.acceleration
        if ground != "none":
            down = moved[:, -1] < 0.0
            if ground == "stick":
                on_ground = down & (self.position[:, -1] <= 0.0)
                moved[on_ground] = self.position[on_ground]
                self.acceleration[down] = 0.0
            moved[down, -1] = 0.0
            self.velocity[down] = 0.0
        self.position = moved
        self.tick += 1
        late = 0.0 if self.params.integrator == "author" else h
        velocity = self.velocity + late * self.acceleration
        before = self.acceleration
        self.acceleration = self.forces(velocity) / self.network.masses[:, None]
        self.velocity = self.velocity + 0.5 * h * (before + self.acceleration)

    def run(self, steps: int) -> None:
        """Advance `steps` steps."""
        for _ in range(steps):
            self.step()
