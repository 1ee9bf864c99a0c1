# SPDX-License-Identifier: Apache-2.0
"""`loco run`: start a node set, monitor it, record it and stop it cleanly."""

from __future__ import annotations

import contextlib
import json
import os
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any, NamedTuple

import yaml

from loco_control.exceptions import GraphError, ParameterError
from loco_control.faults import check
from loco_control.files import locked
from loco_control.params import Params, from_dict, to_dict
from loco_control.realtime import RealtimeParams
from loco_control.ros.fault_node import abilities
from loco_learning.runs.experiment import Experiment
from loco_sim.engines import require
from loco_sim.params import TickParams

from ..bag.writer import Limits
from ..outcome import Outcome, Progress, check_new, describe, duration_of, remove_bag
from . import node_set
from .hardware import driven
from .processes import NO_RESTART, RECORDER, Guard, Process, Restart, start_nodes
from .start import StartLimits
from .watch import Watch

LAYOUTS = ("composed", "processes")
# Files of a robot that are attached to the bag.
_ATTACHED = (("experiment", ".yaml"), ("params", ".yaml"), ("weights", ".npz"))


class Helper(NamedTuple):
    """A node that takes part in a run but is not part of a node set."""

    name: str
    cls: str  # module:Class
    parameters: dict[str, Any]
    table: str = ""  # topic table whose topics are recorded too


@dataclass(frozen=True)
class RunOptions:
    """Layout, clock, faults and recording of a run.

    Attributes:
        layout: ``composed`` (one process) or ``processes`` (one per node).
        clock: ``lockstep``, ``asap`` or ``realtime``.
        speed: Largest multiple of real time in lockstep, 0 for no limit.
        nodes: Name or path of the node set; default that of the experiment's class.
        helpers: Further nodes, each in its own process, without a namespace.
        written: Topics to record; empty for all.
        faults: Faults of topics in the graph of each robot, for `loco_control.faults.parse`.
        realtime: Requests of the nodes' processes to the kernel, fields of `RealtimeParams`.
        limits: Size and time after which the next file of the bag begins.
        hardware: Wiring file of a real robot that replaces the plant.
    """

    layout: str = "composed"
    clock: str = "lockstep"
    speed: float = 0.0
    nodes: str | None = None
    helpers: Sequence[Helper] = ()
    written: Sequence[str] = ()
    faults: Sequence[str] = ()
    realtime: Mapping[str, Any] | None = None
    limits: Limits | None = None
    hardware: str = ""


def run(
    experiment: Experiment,
    folder: Path,
    layout: str = "composed",
    clock: str = "lockstep",
    namespace: str = "",
    **options: Any,
) -> Outcome:
    """Run an experiment as a ROS graph in a namespace and record it; see `run_robots`."""
    return run_robots({namespace: experiment}, folder, layout, clock, **options)


def run_robots(
    robots: Mapping[str, Experiment],
    folder: Path,
    layout: str = "composed",
    clock: str = "lockstep",
    on_progress: Callable[[Progress], Any] = lambda progress: None,
    start_timeout: float = StartLimits.timeout,
    **options: Any,
) -> Outcome:
    """Run several robots side by side, each in a namespace, into one bag.

    Args:
        robots: Experiment by namespace.
        folder: New folder for the bag, logs and parameters.
        layout: ``composed`` (one process) or ``processes`` (one per node).
        clock: ``lockstep``, ``asap`` or ``realtime``.
        on_progress: Called about ten times per second of wall time; a true return value ends the
            run.
        start_timeout: Time without progress after which the start counts as failed [s].
        options: Further fields of `RunOptions`, and of `TickParams`, e.g. ``stop_on_fall=False``.

    Raises:
        GraphError: A node died or never got ready, no tick arrives, or another run uses the
            ROS domain.
        ParameterError: The layout is unknown, the folder holds a bag, an engine is not installed,
            or a fault is invalid.
    """
    if layout not in LAYOUTS:
        raise ParameterError(f"layout must be one of {', '.join(LAYOUTS)}, got {layout!r}")
    check_new(folder)
    limits_of_start = StartLimits(start_timeout)
    names = {f.name for f in fields(RunOptions)} & options.keys()
    selected = RunOptions(layout, clock, **{name: options.pop(name) for name in names})
    for experiment in () if selected.hardware else robots.values():
        if "engine" in getattr(experiment, "sim", ()):  # a mass-spring network needs none
            require(experiment.sim["engine"])
    with _domain_lock(robots):
        folder = Path(folder).resolve()
        window = max(2, TickParams().flow_window // max(1, len(robots)))
        pace = {"clock": clock, "speed": float(selected.speed)}
        tick = _changes(TickParams(), {"flow_window": window, **pace, **options}, "tick") | pace
        realtime = _changes(RealtimeParams(), selected.realtime or {}, "realtime")
        plan = _Plan(robots, folder, replace(selected, realtime=realtime), tick)
        plan.write()
        duration = max(map(duration_of, robots.values()))
        guard = Guard()
        processes = plan.start(guard)
        watch = Watch(processes, folder, duration, on_progress, plan.tables, guard, limits_of_start)
        try:
            return watch.run()
        except GraphError:
            if not watch.began_alone:
                remove_bag(folder)  # it holds no data; the logs are kept
            raise


def _changes(defaults: Params, values: Mapping[str, Any], where: str) -> dict[str, Any]:
    """Checked values that differ from the defaults."""
    checked = to_dict(from_dict(type(defaults), values, where))
    return {key: value for key, value in checked.items() if value != getattr(defaults, key)}


class _Plan:
    """Files and processes of a run."""

    def __init__(
        self,
        robots: Mapping[str, Experiment],
        folder: Path,
        options: RunOptions,
        tick: dict[str, Any],
    ):
        self._robots, self._folder, self._options, self._tick = robots, folder, options, tick
        self._sets = {space: options.nodes or e.node_set for space, e in robots.items()}
        self.tables = {space: node_set.table_of(name) for space, name in self._sets.items()}
        self._specs = {space: node_set.load(name) for space, name in self._sets.items()}
        for space, specs in self._specs.items() if options.hardware else ():
            self._specs[space] = driven(specs, robots[space], options.hardware, tick["clock"])
        self._faulted = _faulted(options.faults, self._sets.values())
        if options.faults:
            self._specs = {s: [*specs, node_set.FAULTS] for s, specs in self._specs.items()}

        # The files of a single robot are named without its namespace.
        self._tags = {s: s.replace("/", "_") if len(robots) > 1 else "" for s in robots}

    def _path(self, stem: str, tag: str, suffix: str) -> Path:
        return self._folder / f"{stem}{'_' if tag else ''}{tag}{suffix}"

    def write(self) -> None:
        """Write resolved experiments and ROS parameters; none is written if one is invalid."""
        files = self._files()
        self._folder.mkdir(parents=True, exist_ok=True)
        for path, content in files.items():
            path.write_text(yaml.safe_dump(content, sort_keys=False))

    def _files(self) -> dict[Path, dict[str, Any]]:
        """Content of the YAML files, by path."""
        recorder, files, o = self._recorder(), {}, self._options
        for space, experiment in self._robots.items():
            tag = self._tags[space]
            files[self._path("experiment", tag, ".yaml")] = to_dict(experiment)
            run = {"recorded": True, "recorder": None if tag else recorder}
            run["weights"] = str(self._path("weights", tag, ".npz"))
            table = self.tables[space]
            run |= {"faulted": self._faulted, "faults": {"table": table, "faults": list(o.faults)}}
            run["realtime"], run["hardware"] = o.realtime, o.hardware
            tick = {**self._tick, "duration": duration_of(experiment)}
            content = node_set.parameter_file(self._specs[space], experiment, tick, run)
            files[self._path("params", tag, ".yaml")] = content
        if "" not in self._tags.values():
            files[self._folder / "params.yaml"] = node_set.recorder_parameters(recorder)
        for helper in o.helpers:
            content = {f"/**/{helper.name}": {"ros__parameters": helper.parameters}}
            files[self._path("params", helper.name, ".yaml")] = content
        return files

    def _recorder(self) -> dict[str, Any]:
        """Parameters of the recorder."""
        first, o = next(iter(self._robots.values())), self._options
        custom = describe(first, layout=o.layout, clock=o.clock)
        if list(self._robots) != [""]:
            names = {space: e.name for space, e in self._robots.items()}
            custom["namespaces"] = json.dumps(names)
        if o.hardware:
            custom["hardware"] = Path(o.hardware).read_text()
        if o.faults:
            custom["faults"] = json.dumps(list(o.faults))
        files = [self._path(s, tag, x) for tag in self._tags.values() for s, x in _ATTACHED]
        if "" not in self._tags.values():
            files.append(self._folder / "params.yaml")
        tables, limits = dict(self.tables), o.limits or Limits()
        for helper in o.helpers:
            if helper.table:
                tables.setdefault("", helper.table)
        return {
            "bag": str(self._folder),
            "custom_data": json.dumps(custom),
            "reliable": o.clock != "lockstep",
            "attach": [str(path) for path in files],
            "status_every": self._tick.get("flow_window", TickParams().flow_window) // 2,
            "control_rate": first.control_rate,
            "namespaces": list(tables),
            "tables": list(tables.values()),
            "faulted": list(self._faulted) or [""],
            "allow_faults": bool(self._faulted),
            "written": list(o.written) or [""],
            "max_bagfile_size": int(limits.size),
            "max_bagfile_duration": float(limits.duration),
        }

    def start(self, guard: Guard) -> list[Process]:
        """Start every node, the recorder last."""
        self._guard, started = guard, []
        for space, specs in self._specs.items():
            for name, group in node_set.grouped(specs, self._options.layout).items():
                # A process may restart only if all its nodes may.
                restart = min((s.restart for s in group), key=lambda r: r.per_minute)
                classes = [s.cls for s in group]
                started.append(self._process(name, classes, space, self._tags[space], restart))
        for helper in self._options.helpers:
            started.append(self._process(helper.name, [helper.cls], "", helper.name))
        return [
            *started,
            self._process(RECORDER, ["loco_bringup.record.recorder:RecorderNode"], "", ""),
        ]

    def _process(
        self, name: str, classes: list[str], space: str, params: str, restart: Restart = NO_RESTART
    ) -> Process:
        """Start a process of nodes in a namespace, with a parameter file."""
        name, path = f"{space}/{name}".lstrip("/"), self._path("params", params, ".yaml")
        log = self._folder / "logs" / f"{name.replace('/', '_')}.log"
        return start_nodes(name, classes, path, log, self._guard, space, restart)


def _faulted(faults: Sequence[str], sets: Iterable[str]) -> list[str]:
    """Topics that the faults damage, in the graphs of these node sets.

    Raises:
        ParameterError: A fault is invalid, or does not apply to the messages of its topic.
        NameUnknownError: A graph has no such topic, or there is no such fault.
    """
    if not faults:
        return []
    parsed = [f for name in sets for f in check(faults, abilities(node_set.table_of(name)))]
    return list(dict.fromkeys(topic for topic, _ in parsed))


@contextlib.contextmanager
def _domain_lock(namespaces: Iterable[str] = ("",)) -> Iterator[None]:
    """Lock a ROS domain and namespaces for one run on this machine.

    The system releases the lock of a killed run.
    """
    domain = os.environ.get("ROS_DOMAIN_ID", "0")
    with contextlib.ExitStack() as stack:
        for namespace in sorted(namespaces):
            name = "-".join(filter(None, [domain, namespace.replace("/", "-")]))
            try:
                stack.enter_context(locked(f"domain-{name}"))
            except BlockingIOError:
                where = f" in namespace {namespace}" if namespace else ""
                raise GraphError(
                    f"another loco run uses ROS domain {domain}{where}; wait for it, or set "
                    "ROS_DOMAIN_ID to another number in 0 … 101"
                ) from None
        yield
