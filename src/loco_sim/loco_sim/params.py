# SPDX-License-Identifier: Apache-2.0
"""Parameters of the simulated world and its clock; a robot's are in its ``robot.yaml``."""

from __future__ import annotations

from dataclasses import dataclass

from loco_control.exceptions import ParameterError
from loco_control.params import Params, parameter

from .engines import ENGINES, default_engine

CLOCKS = ("lockstep", "asap", "realtime")


@dataclass(frozen=True)
class SimParams(Params):
    """Physics, contact and sensors. Joint damping and limits come from the URDF.

    Source: friction and rigid feet as in DLS-Lab's hyq-description (urdfs/leg/leg.gazebo).
    """

    engine: str = parameter(
        default_engine, "physics engine; default the first one installed", choices=ENGINES
    )
    physics_rate: float = parameter(
        1000.0, "physics steps per second, before sub-stepping", "Hz", low=100.0, high=20000.0
    )
    damping_limit: float = parameter(
        0.5,
        "largest kd dt / I at which damping is held over a physics step; "
        "above it, see implicit_damping, or the step is divided. Held "
        "damping diverges at 2 and changes the power of a gait by 30 % at 1.2",
        low=0.01,
        high=1.9,
    )
    implicit_damping: bool = parameter(
        True,
        "damping of impedance drives, springs and joints that would need "
        "sub-steps is implicit instead, unless an effect acts on drives or joints",
    )
    max_substeps: int = parameter(
        20, "gains that need more sub-steps than this are refused", low=1, high=1000
    )
    gravity: float = parameter(9.81, "acceleration of gravity", "m/s²", low=0.0)
    friction: float = parameter(1.0, "Coulomb friction between robot and ground", low=0.0)
    restitution: float = parameter(0.0, "restitution between robot and ground", low=0.0, high=1.0)
    contact_stiffness: float = parameter(0.0, "stiffness of a contact, 0 is rigid", "N/m", low=0.0)
    contact_damping: float = parameter(
        1000.0, "damping of a contact, used when contact_stiffness > 0", "N·s/m", low=0.0
    )
    solver_iterations: int = parameter(50, "iterations of the contact solver", low=1, high=1000)
    grf: str = parameter(
        "mean",
        "ground reaction force: mean over the control period, or of its last physics step",
        choices=("mean", "last"),
    )
    contact_threshold: float = parameter(
        1.0, "a foot with more ground reaction force than this is in contact", "N", low=0.0
    )
    safety: bool = parameter(
        True, "if a command is not finite, hold and count the last valid one; false: raise"
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.engine == "mujoco" and self.restitution > 0.0:
            raise ParameterError(
                f"sim.restitution is {self.restitution:g}, which MuJoCo's contacts do not have: "
                "leave it at 0, or take --engine pybullet"
            )


@dataclass(frozen=True)
class TickParams(Params):
    """Clock and pace of the ticks."""

    clock: str = parameter(
        "lockstep",
        "lockstep waits for every command and for the recorder, "
        "asap only for the commands, realtime for the wall clock",
        choices=CLOCKS,
    )
    speed: float = parameter(
        0.0, "lockstep: largest speed relative to real time; 0: no limit", "x", 0.0, 1000.0
    )
    duration: float = parameter(0.0, "stop after this simulated time; 0: never", "s", 0.0, 1e7)
    stop_on_fall: bool = parameter(True, "end the run when the robot falls")
    leave: bool = parameter(
        False, "the plant's process ends a second after its run, to signal its end"
    )
    # Shared memory of Fast DDS has 512 messages and 512 KiB per process, and a tick of
    # all nodes in one process is 10 messages and 4.3 KiB. Robots that share a recorder share
    # its 512: `loco run` gives each a part of the window.
    flow_window: int = parameter(
        40, "lockstep: ticks that the recorder may be behind before the plant waits", "ticks", 2, 50
    )
    catch_up: int = parameter(
        25,
        "realtime: largest number of missed ticks executed after a stall; the others are dropped",
        "ticks",
        1,
        1000,
    )
    command_timeout: float = parameter(
        0.06,
        "a command is held until this age; then `late` applies",
        "s",
        0.004,
        10.0,
    )
    heartbeat: float = parameter(
        0.0,
        "longest wall time without a message on `heartbeat` "
        "before the emergency stop; 0: no heartbeat needed",
        "s",
        0.0,
        60.0,
    )
    late: str = parameter(
        "hold",
        "if commands are too late: hold damps the joints until "
        "commands return, safe-stop until the emergency stop is reset",
        choices=("hold", "safe-stop"),
    )
