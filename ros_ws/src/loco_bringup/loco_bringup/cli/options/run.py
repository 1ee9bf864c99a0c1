# SPDX-License-Identifier: Apache-2.0
"""Options of the commands that run robots or inspect the running graph."""

from __future__ import annotations

from argparse import ArgumentParser
from pathlib import Path

from loco_sim.engines import ENGINES

from ...graph.start import StartLimits
from .registry import group

command = group("Run robots")

SCHEDULER = "dask scheduler to use instead of processes here, tcp://HOST:PORT"
MORE = """

Clocks: lockstep steps when every command has arrived and the recorder keeps up
(deterministic); asap does not wait for the recorder; realtime follows the wall clock.
Layouts: composed puts all nodes in one process, processes gives each its own,
rollout calls the same objects without ROS and writes the same topics to a bag.

Faults stand between the writer and the readers of a topic; any number, also on one topic:
  --fault motion_command:drop:probability=0.1          every tenth command is lost
  --fault robot_state:delay:messages=3:start=2:stop=4  three ticks late, from 2 s to 4 s
kinds: drop, delay (messages), duplicate (times), reorder (messages), nan, freeze,
       clock_jump (offset [s]), stuck; all have start and stop [s], probability and seed.
Topics are those of docs/topics.md; docs/faults.md says what the robot does then.
"""
NEW = """

The folder holds
  NAME.urdf        the URDF with small faults mended; meshes stay where they are
  robot.yaml       joints, feet, posture, gains, contacts; what is guessed is marked
  experiment.yaml  the robot stands for 5 s, or swings for 10 s if its base is bolted
  picture.png      how it stands

Read from URDF, xacro or MJCF: joints, limits, masses, shapes. Guessed: what it stands on and
which way is up, a posture with level feet and the mass over them, gains that carry the weight and are
stable at the physics step, limits that are missing or 0, legs for the gait generator. The
robot is tried in the engine; nothing is written unless it stands for 5 s or swings for 2 s.

  loco robot new go1.urdf --out go1
  loco run go1/experiment.yaml
  loco gap experiments go1      experiments that excite it, to compare with recordings

docs/robot_yaml.md says what each line of robot.yaml means.
"""


def split(p: ArgumentParser) -> None:
    """Options for splitting a bag, of all commands that record."""
    p.add_argument("--max-bag-size", type=int, default=0, metavar="BYTES",
                   help="begin the next file of the bag after so many bytes")  # fmt: skip
    p.add_argument("--max-bag-duration", type=float, default=0.0, metavar="S",
                   help="begin the next file of the bag after so many seconds")  # fmt: skip


def engine(p: ArgumentParser) -> None:
    """Option for the physics engine, of all commands that simulate."""
    text = "physics engine (default the experiment's, or the first one installed)"
    p.add_argument("--engine", choices=ENGINES, help=text)


@command("demo", "cli.demo:run_demo", "run hyq_trot_reflex, replay its bag, write its report")
def demo(p: ArgumentParser) -> None:
    """Options of `loco demo`."""
    p.add_argument("--out", type=Path, help="new bag folder (default bags/NAME_TIME)")


@command("run --layout rollout", "cli.rollout:run",
         "the same objects without ROS, into the same bag")  # fmt: skip
@command("run", "cli.run:run", "run an experiment as a ROS 2 graph and record it")
def run(p: ArgumentParser) -> None:
    """Options of `loco run`."""
    p.description += MORE
    p.add_argument("experiment", help="name (see `loco list`) or path of a YAML file")
    p.add_argument("--layout", default="composed", choices=("composed", "processes", "rollout"),
                   help="default composed")  # fmt: skip
    p.add_argument("--clock", default="lockstep", choices=("lockstep", "asap", "realtime"),
                   help="default lockstep")  # fmt: skip
    p.add_argument("--speed", type=float, default=0.0, help="lockstep: at most this x real time")
    p.add_argument("--start-timeout", type=float, default=StartLimits.timeout, metavar="SECONDS",
                   help="give up when nodes that start make no progress for so long "
                        "(default 60)")  # fmt: skip
    p.add_argument("--duration", type=float, help="length [s], instead of the experiment's")
    p.add_argument("--seed", type=int, help="seed, instead of the experiment's")
    engine(p)
    p.add_argument("--set", action="append", default=[], metavar="KEY=VALUE",
                   help="override one value, e.g. gait.speed=0.3 (repeatable)")  # fmt: skip
    p.add_argument("--nodes", help="node set, name or YAML path (default: as the experiment)")
    p.add_argument("--fault", action="append", default=[], metavar="TOPIC:KIND[:NAME=VALUE]",
                   help="damage the messages of a topic (repeatable)")  # fmt: skip
    p.add_argument("--tick", action="append", default=[], metavar="KEY=VALUE",
                   help="a parameter of the plant's clock, e.g. late=safe-stop")  # fmt: skip
    p.add_argument("--realtime", action="append", default=[], metavar="KEY=VALUE",
                   help="ask the kernel, e.g. for fifo=80, cpus=1, lock_memory=true, "
                   "timer_slack=1000")  # fmt: skip
    p.add_argument("--hardware", default="", metavar="FILE",
                   help="servos of a real robot that takes the place of the simulated one, in "
                   "real time")  # fmt: skip
    p.add_argument("--namespace", default="", help="namespace of all nodes")
    p.add_argument("--out", type=Path, help="new bag folder (default bags/NAME_TIME)")
    split(p)
    p.add_argument("--report", action="store_true", help="write the report when it is done")
    p.add_argument("--view", action="store_true", help="show it in Rerun when it is done")


@command("robot", "robot.terminal:show_robots", "show the robots of loco and those in folders here")
def robot(p: ArgumentParser) -> None:
    """Options of `loco robot`."""
    p.description += "\n\nloco robot new URDF writes a folder for a robot of your own."


@command("robot new", "robot.terminal:show_new",
         "write a first robot folder from any URDF, and say what is guessed")  # fmt: skip
def robot_new(p: ArgumentParser) -> None:
    """Options of `loco robot new`."""
    p.description += NEW
    p.add_argument("urdf", type=Path, help="URDF, xacro or MJCF, as in a ROS package or a download")
    p.add_argument("--out", type=Path, metavar="DIR",
                   help="new folder (default: the name of the file)")  # fmt: skip


@command("list", "cli.listing:show", "show experiments, robots, studies, effects, topics and bags")
def list_(p: ArgumentParser) -> None:
    """Options of `loco list`."""
    names = ("experiments", "robots", "studies", "effects", "topics", "bags")
    p.add_argument("what", nargs="?", choices=names, help="one of the lists (default: all)")


@command("schema", "cli.listing:show_schema", "print the JSON Schema of a kind of YAML file, by "
         "which editors complete and check")  # fmt: skip
def schema(p: ArgumentParser) -> None:
    """Options of `loco schema`."""
    p.description += """

The first line of a file tells the editor: # yaml-language-server: $schema=schemas/robot.json
  loco schema experiment > experiment.json
  loco schema --out schemas
"""
    p.add_argument("kind", nargs="?", help="kind of file", choices=(
        "experiment", "robot", "model", "gait", "study", "mapping", "wiring", "plan"))  # fmt: skip
    p.add_argument("--out", type=Path, help="folder that gets a file of each kind, or of one")


@command("top", "doctor.top:show_top", "show the running graph: rates, lateness, drops, CPU, phase")
def top(p: ArgumentParser) -> None:
    """Options of `loco top`."""
    p.add_argument("--once", action="store_true", help="print once, for scripts")
    p.add_argument("--interval", type=float, default=1.0, help="seconds between pictures")


@command("doctor", "doctor.terminal:show_doctor",
         "say why nothing moves (exit code 1: it has found a fault)")  # fmt: skip
def doctor(p: ArgumentParser) -> None:
    """Options of `loco doctor`."""
    p.add_argument("--seconds", type=float, default=5.0, help="how long to listen (default 5)")
    p.add_argument("--json", action="store_true", help="print JSON")
    p.add_argument("--clean", action="store_true", help="remove shared memory of dead processes")


command("ros2", "ros2.main:run", "topic, node, param, service, action and run, as ros2 "
        "has them, without apt")(None)  # fmt: skip


@command("hardware", "hardware.terminal:show_servos",
         "ask the servos of a real robot, with the torque off (exit code 1: a fault)")  # fmt: skip
def hardware(p: ArgumentParser) -> None:
    """Options of `loco hardware`."""
    p.add_argument("robot", help="robot, by name or folder")
    p.add_argument("file", type=Path, help="wiring file: bus and servos (docs/hardware.md)")


@command("hardware simulate", "hardware.terminal:simulate",
         "serve simulated servos on a serial port, with effects and faults")  # fmt: skip
def hardware_simulate(p: ArgumentParser) -> None:
    """Options of `loco hardware simulate`."""
    hardware(p)
    p.add_argument("--out", type=Path, default=Path("simulated_servos.yaml"), metavar="FILE",
                   help="wiring file with the port of the simulated bus "
                   "(default %(default)s)")  # fmt: skip
    p.add_argument("--effects", default="[]", metavar="YAML",
                   help="departures from the ideal robot, as in experiments")  # fmt: skip
    p.add_argument("--fault", action="append", default=[], metavar="KIND=VALUE[@S]",
                   help="lost=SHARE or garbled=SHARE of packets, silent=ID, hot=ID; from S seconds "
                   "on")  # fmt: skip
    p.add_argument("--seconds", type=float, default=0.0, help="end after this time")


@command("estop", "cli.estop:show_estop",
         "stop the robots that run: their joints are damped until a reset")  # fmt: skip
def estop(p: ArgumentParser) -> None:
    """Options of `loco estop`."""
    p.description += "\n\nStops every robot on the ROS domain, or that of a namespace."
    p.add_argument("--reset", action="store_true", help="let them move again")
    p.add_argument("--keys", action="store_true",
                   help="stay: space stops, r resets, q quits")  # fmt: skip
    p.add_argument("--heartbeat", type=float, default=0.0, metavar="HZ",
                   help="say this often that you are there, until Ctrl-C (for plants with "
                   "the parameter heartbeat)")  # fmt: skip
    p.add_argument("--namespace", default=None, help="only the robot in this namespace")
