# SPDX-License-Identifier: Apache-2.0
"""`loco run`: starts a node set, watches it, records it and stops it cleanly."""

from __future__ import annotations

import fcntl
import importlib.metadata
import json
import logging
import os
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from datetime import datetime
from pathlib import Path
from typing import Any

import yaml

from loco_control.exceptions import GraphError, ParameterError
from loco_control.params import to_dict
from loco_learning.experiment import Experiment

from . import node_set
from .processes import Process, stop_all

log = logging.getLogger(__name__)

LAYOUTS = ("composed", "processes")
START_TIMEOUT = 60.0  # wall time until every node must be matched [s]
STALL_TIMEOUT = 30.0  # wall time without a tick after which a run is given up [s]
VERSIONS = ("loco", "ros-rclpy", "pybullet", "numpy", "scipy", "numba", "mcap")


@dataclass
class Progress:
    """What the progress line shows."""

    phase: str = "starting"
    sim_time: float = 0.0
    duration: float = 0.0
    real_time_factor: float = 0.0


@dataclass
class Outcome:
    """How a run ended."""

    folder: Path
    text: str = ""
    fallen: bool = False
    interrupted: bool = False
    real_time_factor: float = 0.0
    dropped: int = 0
    exit_codes: dict[str, int] = field(default_factory=dict)

    @property
    def exit_code(self) -> int:
        """0 done, 3 fell, 130 interrupted."""
        return 130 if self.interrupted else 3 if self.fallen else 0


def run(
    experiment: Experiment,
    folder: Path,
    layout: str = "composed",
    clock: str = "lockstep",
    speed: float = 0.0,
    nodes: str = "hyq",
    on_progress: Callable[[Progress], None] = lambda progress: None,
) -> Outcome:
    """Run an experiment as a ROS graph and record it.

    Args:
        experiment: What to run.
        folder: New folder for the bag, logs and parameters.
        layout: ``composed`` (one process) or ``processes`` (one each).
        clock: ``lockstep``, ``asap`` or ``realtime``.
        speed: Lockstep: at most this many times real time, 0 for no limit.
        nodes: Node set, by name or path.
        on_progress: Called about ten times a second of wall time.

    Raises:
        GraphError: A node died or never got ready, nothing ticks, or another run
            has the ROS domain.
        ParameterError: `layout` is unknown or `folder` holds a bag.
    """
    if layout not in LAYOUTS:
        raise ParameterError(f"layout must be one of {', '.join(LAYOUTS)}, got {layout!r}")
    if any(Path(folder).glob("*.mcap")):
        raise ParameterError(f"{folder} holds a bag already; choose another folder")
    with _domain_lock():
        folder = Path(folder).resolve()
        folder.mkdir(parents=True, exist_ok=True)
        specs = node_set.load(nodes)
        tick = {"clock": clock, "speed": float(speed), "duration": duration_of(experiment)}
        _write_files(folder, specs, experiment, tick, layout)
        processes = _start(folder, specs, layout)
        return _Watch(processes, folder, duration_of(experiment), on_progress).run()


def default_folder(experiment: Experiment, root: Path = Path("bags")) -> Path:
    """New bag folder named after the experiment and the time."""
    stamp = datetime.now().strftime("%Y%m%d-%H%M%S")
    return root / f"{experiment.name}_{stamp}"


def duration_of(experiment: Experiment) -> float:
    """Simulated time of a run [s]."""
    return experiment.ticks / experiment.control_rate


def describe(experiment: Experiment, **more: Any) -> dict[str, str]:
    """What a bag says of its run: experiment, seed, versions."""
    versions = {}
    for name in VERSIONS:
        try:
            versions[name] = importlib.metadata.version(name)
        except importlib.metadata.PackageNotFoundError:
            continue
    values = {"experiment": experiment.name, "seed": experiment.seed, "robot": experiment.robot}
    values |= {"recorded_at": datetime.now().astimezone().isoformat(timespec="seconds")}
    values |= {"versions": json.dumps(versions), **more}
    return {key: str(value) for key, value in values.items()}


def _write_files(
    folder: Path, specs: list, experiment: Experiment, tick: dict[str, Any], layout: str
) -> None:
    resolved = folder / "experiment.yaml"
    resolved.write_text(yaml.safe_dump(to_dict(experiment), sort_keys=False))
    weights = folder / "weights.npz"
    custom = describe(experiment, layout=layout, clock=tick["clock"])
    recorder = {
        "bag": str(folder),
        "custom_data": json.dumps(custom),
        "reliable": tick["clock"] != "lockstep",
        "attach": [str(resolved), str(folder / "params.yaml"), str(weights)],
    }
    run = {"recorded": True, "recorder": recorder, "weights": str(weights)}
    content = node_set.parameter_file(specs, experiment, tick, run)
    (folder / "params.yaml").write_text(yaml.safe_dump(content, sort_keys=False))


def _start(folder: Path, specs: list, layout: str) -> list[Process]:
    ros = ["--ros-args", "--params-file", str(folder / "params.yaml")]
    groups = {"nodes": [s.cls for s in specs]} if layout == "composed" else {
        s.name: [s.cls] for s in specs
    }  # fmt: skip
    groups["recorder"] = ["loco_bringup.recorder:RecorderNode"]
    logs = folder / "logs"
    return [
        Process(name, ["-m", "loco_bringup.composed", *classes, *ros], logs / f"{name}.log")
        for name, classes in groups.items()
    ]


class _Watch:
    """Listens to events and diagnostics until the run is over, then stops it."""

    def __init__(
        self, processes: list[Process], folder: Path, duration: float, on_progress: Callable
    ):
        self._processes = processes
        self._on_progress = on_progress
        self._progress = Progress(duration=duration)
        self.outcome = Outcome(folder)
        self._waiting: dict[str, str] = {}
        self._started = self._finished = False
        self._error: str | None = None
        self._final_tick, self._recorder_tick, self._final_time = -1, -1, 0.0
        self._moved = time.monotonic()

    def run(self) -> Outcome:
        """Watch to the end. Every way out stops all processes first."""
        try:
            with _Listener(self._on_event, self._on_diagnostics, self._on_recorder) as listener:
                while not self._done():
                    listener.spin()
                    self._check()
                    self._on_progress(self._progress)
        except KeyboardInterrupt:
            self.outcome.interrupted = True
            self.outcome.text = "interrupted"
        finally:
            self.outcome.exit_codes = stop_all(self._processes)
        return self.outcome

    def _done(self) -> bool:
        heard = self._progress.sim_time >= self._final_time - 1e-9  # the last diagnostics
        return self._finished and heard and self._recorder_tick >= self._final_tick

    def _check(self) -> None:
        if self._error:
            raise GraphError(self._error)
        for process in self._processes:
            if process.code is not None:
                raise GraphError(
                    f"{process.name} died with exit code {process.code}; last lines of "
                    f"{process.log}:\n{process.tail()}"
                )
        idle = time.monotonic() - self._moved
        if not self._started and idle > START_TIMEOUT:
            waits = "; ".join(f"{n}: {w}" for n, w in sorted(self._waiting.items()))
            raise GraphError(f"not ready after {START_TIMEOUT:.0f} s; {waits or 'no node spoke'}")
        if self._started and idle > STALL_TIMEOUT:
            raise GraphError(
                f"nothing moved for {STALL_TIMEOUT:.0f} s at {self._progress.sim_time:.3f} s; "
                f"last tick {self._final_tick if self._finished else 'not reached'}, "
                f"recorder at tick {self._recorder_tick}"
            )

    def _on_event(self, event: Any) -> None:
        self._moved = time.monotonic()
        if event.kind == "started":
            self._started = True
        elif event.kind == "phase":
            self._progress.phase = event.text
        elif event.kind == "fall":
            self.outcome.fallen = True
        elif event.kind == "error":
            self._error = f"{event.node}: {event.text}"
        elif event.kind == "finished":
            self._finished = True
            self._final_tick = event.tick
            self._final_time = event.stamp.sec + event.stamp.nanosec / 1e9
            self.outcome.text = event.text

    def _on_diagnostics(self, array: Any) -> None:
        for status in array.status:
            values = {v.key: v.value for v in status.values}
            for key in ("waiting for", "waiting for nodes"):
                if values.get(key):
                    self._waiting[status.name] = values[key]
            if status.name == "robot_sim" and "sim_time" in values:
                t = float(values["sim_time"])
                if t > self._progress.sim_time:
                    self._moved = time.monotonic()
                self._progress.sim_time = t
                self._progress.real_time_factor = float(values["real_time_factor"])
                self.outcome.real_time_factor = self._progress.real_time_factor

    def _on_recorder(self, status: Any) -> None:
        self._recorder_tick = status.tick
        self.outcome.dropped = status.dropped


class _Listener:
    """The supervisor's own node: events, diagnostics and recorder status."""

    def __init__(self, on_event: Callable, on_diagnostics: Callable, on_recorder: Callable):
        self._callbacks = {
            "events": on_event,
            "/diagnostics": on_diagnostics,
            "recorder_status": on_recorder,
        }

    def __enter__(self) -> _Listener:
        import rclpy
        import rclpy.task
        from rclpy.experimental import EventsExecutor
        from rclpy.signals import SignalHandlerOptions

        from loco_control.ros.topics import topic

        # Ctrl-C must reach us as KeyboardInterrupt while the context lives on.
        self._context = rclpy.Context()
        rclpy.init(args=[], context=self._context, signal_handler_options=SignalHandlerOptions.NO)
        self._node = rclpy.create_node("supervisor", context=self._context)
        for name, callback in self._callbacks.items():
            row = topic(name)
            self._node.create_subscription(row.type, row.name, callback, row.qos.reader(100))
        self._executor = EventsExecutor(context=self._context)
        self._executor.add_node(self._node)
        self._never = rclpy.task.Future()
        return self

    def spin(self) -> None:
        """Handle what arrives within a tenth of a second."""
        self._executor.spin_until_future_complete(self._never, timeout_sec=0.1)

    def __exit__(self, *_: object) -> None:
        self._node.destroy_node()
        self._context.try_shutdown()


class _domain_lock:  # noqa: N801 (a context manager, used like a function)
    """One run per ROS domain on this machine; a killed run frees it by itself."""

    def __enter__(self) -> None:
        domain = os.environ.get("ROS_DOMAIN_ID", "0")
        path = Path(tempfile.gettempdir()) / f"loco-domain-{domain}-{os.getuid()}.lock"
        self._file = open(path, "a+")  # noqa: SIM115 (the lock lives as long as the file)
        try:
            fcntl.flock(self._file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError:
            self._file.close()
            raise GraphError(
                f"another loco run uses ROS domain {domain}; wait for it, or set ROS_DOMAIN_ID "
                "to another number in 0 … 101"
            ) from None

    def __exit__(self, *_: object) -> None:
        self._file.close()
