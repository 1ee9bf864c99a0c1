# SPDX-License-Identifier: Apache-2.0
"""Options of the commands that run robots or inspect the running graph."""

from __future__ import annotations

from argparse import ArgumentParser
from pathlib import Path

from loco_sim.engines import ENGINES

from ...graph.start import StartLimits
from .registry import add_out, group, option

command = group("Run robots")

SCHEDULER = "dask scheduler to use instead of processes here, tcp://HOST:PORT"


def split(p: ArgumentParser) -> None:
    """Options for splitting a bag, of all commands that record."""
    option(p, "--max-bag-size", 0, "begin the next file of the bag after so many bytes", "BYTES")
    option(
        p, "--max-bag-duration", 0.0, "begin the next file of the bag after so many seconds", "S"
    )


def engine(p: ArgumentParser) -> None:
    """Option for the physics engine, of all commands that simulate."""
    text = "physics engine (default the experiment's, or the first one installed)"
    p.add_argument("--engine", choices=ENGINES, help=text)


def live(p: ArgumentParser, text: str) -> None:
    """Options of commands that can listen to a running robot in place of a bag."""
    option(p, "--live", False, text)
    option(
        p,
        "--measured",
        "surrogate_sine",
        "--live: the robot that stands for the real one",
        "EXPERIMENT",
    )
    option(p, "--speed", 1.0, "--live: at most this x real time, 0 for no limit")


@command("demo", "cli.demo:run_demo", "run hyq_trot_reflex, replay its bag, write its report")
def demo(p: ArgumentParser) -> None:
    """Options of `loco demo`."""
    add_out(p, "new bag folder (default bags/NAME_TIME)")


@command("run --layout rollout", "cli.rollout:run",
         "the same objects without ROS, into the same bag")  # fmt: skip
@command("run", "cli.run:run", "run an experiment as a ROS 2 graph and record it")
def run(p: ArgumentParser) -> None:
    """Options of `loco run`.

    Clocks: lockstep steps when every command has arrived and the recorder keeps up
    (deterministic); asap does not wait for the recorder; realtime follows the wall clock.
    Layouts: composed puts all nodes in one process, processes gives each its own,
    rollout calls the same objects without ROS and writes the same topics to a bag.

    A fault damages the messages between writer and readers of a topic. Several are possible:
      --fault motion_command:drop:probability=0.1          every tenth command is lost
      --fault robot_state:delay:messages=3:start=2:stop=4  three ticks late, from 2 s to 4 s
    kinds: drop, delay (messages), duplicate (times), reorder (messages), nan, freeze,
           clock_jump (offset [s]), stuck; all have start and stop [s], probability and seed.
    docs/topics.md lists the topics, docs/faults.md the reactions of the robot.
    """
    p.add_argument("experiment", help="name (see `loco list`) or path of a YAML file")
    p.add_argument("--layout", default="composed", choices=("composed", "processes", "rollout"),
                   help="default composed")  # fmt: skip
    p.add_argument("--clock", default="lockstep", choices=("lockstep", "asap", "realtime"),
                   help="default lockstep")  # fmt: skip
    option(p, "--speed", 0.0, "lockstep: at most this x real time")
    option(p, "--start-timeout", StartLimits.timeout, "give up when nodes that start make no "
           "progress for so long (default 60)", "SECONDS")  # fmt: skip
    option(p, "--duration", float, "length [s], instead of the experiment's")
    option(p, "--seed", int, "seed, instead of the experiment's")
    engine(p)
    option(p, "--set", list, "override one value, e.g. gait.speed=0.3 (repeatable)", "KEY=VALUE")
    option(p, "--nodes", str, "node set, name or YAML path (default: as the experiment)")
    option(p, "--fault", list, "damage the messages of a topic (repeatable)",
           "TOPIC:KIND[:NAME=VALUE]")  # fmt: skip
    option(p, "--tick", list, "a parameter of the plant's clock, e.g. late=safe-stop", "KEY=VALUE")
    option(p, "--realtime", list, "ask the kernel, e.g. for fifo=80, cpus=1, lock_memory=true, "
           "timer_slack=1000", "KEY=VALUE")  # fmt: skip
    option(p, "--hardware", "", "servos of a real robot that takes the place of the simulated one, "
           "in real time", "FILE")  # fmt: skip
    option(p, "--namespace", "", "namespace of all nodes")
    add_out(p, "new bag folder (default bags/NAME_TIME)")
    split(p)
    option(p, "--report", False, "write the report when it is done")
    option(p, "--view", False, "show it in Rerun when it is done")


@command("robot", "robot.terminal:show_robots", "show the robots of loco and those in folders here")
def robot(p: ArgumentParser) -> None:
    """Options of `loco robot`.

    loco robot new URDF writes a folder for a robot of your own.
    """


@command("robot new", "robot.terminal:show_new",
         "write a first robot folder from any URDF, and say what is guessed")  # fmt: skip
def robot_new(p: ArgumentParser) -> None:
    """Options of `loco robot new`.

    The folder holds
      NAME.urdf        the URDF with small faults corrected; meshes are not copied
      robot.yaml       joints, feet, posture, gains, contacts; guesses are marked
      experiment.yaml  the robot stands for 5 s, or swings for 10 s if its base is bolted
      picture.png      the robot in its posture

    Read from URDF, xacro or MJCF: joints, limits, masses, shapes. Guessed: feet or wheels, the
    upward direction, a posture with level feet below the centre of mass, gains that carry the
    weight and are stable at the physics step, limits that are missing or 0, legs for the gait.
    The robot is tried in the engine; nothing is written unless it stands for 5 s or swings for 2 s.

      loco robot new go1.urdf --out go1
      loco run go1/experiment.yaml
      loco gap experiments go1      experiments that excite it, to compare with recordings

    docs/robot_yaml.md explains each key of robot.yaml.
    """
    p.add_argument("urdf", type=Path, help="URDF, xacro or MJCF, as in a ROS package or a download")
    add_out(p, "new folder, which is yours (default: here, by the name of the file)")


@command("list", "cli.listing:show", "show experiments, robots, studies, effects, topics and bags")
def list_(p: ArgumentParser) -> None:
    """Options of `loco list`."""
    names = ("experiments", "robots", "studies", "effects", "topics", "bags")
    text = f"one of the lists ({', '.join(names)}; default: all), or a name in them"
    p.add_argument("what", nargs="?", metavar="NAME", help=text)


@command("schema", "cli.listing:show_schema", "print the JSON Schema of a kind of YAML file, by "
         "which editors complete and check")  # fmt: skip
def schema(p: ArgumentParser) -> None:
    """Options of `loco schema`.

    First line of a YAML file, for the editor: # yaml-language-server: $schema=schemas/robot.json
      loco schema experiment > experiment.json
      loco schema --out schemas
    """
    p.add_argument("kind", nargs="?", help="kind of file", choices=(
        "experiment", "robot", "model", "gait", "study", "mapping", "wiring", "plan"))  # fmt: skip
    add_out(p, "folder that gets a file of each kind, or of one (default: print)")


@command("top", "doctor.top:show_top", "show the running graph: rates, lateness, drops, CPU, phase")
def top(p: ArgumentParser) -> None:
    """Options of `loco top`."""
    option(p, "--once", False, "print once, for scripts")
    option(p, "--interval", 1.0, "seconds between pictures")


@command("doctor", "doctor.terminal:show_doctor",
         "say why nothing moves (exit code 1: it has found a fault)")  # fmt: skip
def doctor(p: ArgumentParser) -> None:
    """Options of `loco doctor`."""
    option(p, "--seconds", 5.0, "how long to listen (default 5)")
    option(p, "--json", False, "print JSON")
    option(p, "--clean", False, "remove shared memory of dead processes")


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
    add_out(p, "wiring file with the port of the simulated bus, or its folder "
            "(default results/simulated_servos.yaml)", file=True)  # fmt: skip
    option(p, "--effects", "[]", "departures from the ideal robot, as in experiments", "YAML")
    option(p, "--fault", list, "lost=SHARE or garbled=SHARE of packets, silent=ID, hot=ID; from S "
           "seconds on", "KIND=VALUE[@S]")  # fmt: skip
    option(p, "--seconds", 0.0, "end after this time")


@command("estop", "cli.estop:show_estop",
         "stop the robots that run: their joints are damped until a reset")  # fmt: skip
def estop(p: ArgumentParser) -> None:
    """Options of `loco estop`.

    Stops every robot on the ROS domain, or the robot of a namespace.
    """
    option(p, "--reset", False, "let them move again")
    option(p, "--keys", False, "stay: space stops, r resets, q quits")
    option(p, "--heartbeat", 0.0, "say this often that you are there, until Ctrl-C (for plants "
           "with the parameter heartbeat)", "HZ")  # fmt: skip
    option(p, "--namespace", str, "only the robot in this namespace")
