# SPDX-License-Identifier: Apache-2.0
"""Tools for tests against a running graph: start it, publish, expect messages, exit codes.

As a pytest plugin (``pytest_plugins = ["loco_bringup.testing"]`` in the top conftest.py)
it gives every worker its own ROS domain and provides the fixture `loco_graph`; see
``docs/testing.md``. ROS is imported when the first graph starts, after the environment
is set.
"""

from __future__ import annotations

import atexit
import contextlib
import os
import shutil
import signal
import tempfile
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from importlib import resources
from pathlib import Path
from typing import Any

import pytest

from loco_control.exceptions import GraphError
from loco_control.files import locked
from loco_control.ros import RANGE, settle_network

__all__ = ["Graph", "claim_domain", "isolate", "loco_graph", "servo_bus"]

ASSETS = Path(str(resources.files("loco_sim"))) / "assets"

DOMAINS = range(1, 102)  # above 101 the ports of Fast DDS overlap with ephemeral ports


def claim_domain() -> int:
    """Reserve a ROS domain that no other test process uses, until this process ends.

    The reservation is a lock on a file in the user's runtime folder: the system releases
    it however the process ends, and xdist workers and other test runs respect it.
    Child processes do not inherit it.

    Raises:
        GraphError: No domain is free.
    """
    for step in range(len(DOMAINS)):
        # Processes start at different domains, since a killed process may still be
        # leaving its domain.
        domain = DOMAINS[(os.getpid() + step) % len(DOMAINS)]
        lock = contextlib.ExitStack()
        try:
            lock.enter_context(locked(f"test-domain-{domain}"))
        except BlockingIOError:
            continue
        atexit.register(lock.close)
        return domain
    raise GraphError(f"all ROS domains from {DOMAINS[0]} to {DOMAINS[-1]} are in use by tests")


def isolate() -> None:
    """Set environment variables that rclpy and NumPy read once: domain, discovery, logs, threads.

    Tests started in the background of a script ignore SIGINT. Processes of the graph would
    inherit this and survive a Ctrl-C, so the default handler is restored.
    """
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)
    logs = tempfile.mkdtemp(prefix="loco_test_logs_")
    atexit.register(shutil.rmtree, logs, ignore_errors=True)
    os.environ.update(
        ROS_DOMAIN_ID=str(claim_domain()),
        **{RANGE: "LOCALHOST"},
        ROS_LOG_DIR=logs,
        OMP_NUM_THREADS="1",
        OPENBLAS_NUM_THREADS="1",
        MPLBACKEND="Agg",
        LOCO_TEST_PROCESS=str(os.getpid()),
    )
    settle_network(os.environ)


@contextlib.contextmanager
def servo_bus(
    robot: str = "servo_pendulum", file: str | Path = "", effects: Sequence[dict[str, Any]] = ()
) -> Iterator[Any]:
    """Simulated servos on a serial port, served by a thread.

    Args:
        robot: Robot, by name or path.
        file: Wiring file; default ``servos.yaml`` of the robot.
        effects: Deviations from the ideal robot, in the format of experiments.

    Yields:
        A `loco_sim.hardware.simulated_bus.SimulatedBus` whose attribute `file` is the wiring file.
    """
    from ..hardware.simulated import make_bus

    end = threading.Event()
    with tempfile.TemporaryDirectory(prefix="loco_bus_") as folder:
        servo_file = Path(folder) / "servos.yaml"
        bus = make_bus(Path(file or ASSETS / robot / "servos.yaml"), robot, servo_file, effects)
        bus.file = servo_file
        thread = threading.Thread(target=bus.serve, args=(end.is_set,), daemon=True)
        thread.start()
        try:
            yield bus
        finally:
            end.set()
            thread.join()
            bus.close()


class Graph:
    """A running node set under test; use it as a context manager.

    Args:
        experiment: Name or path of an experiment, or an `Experiment`.
        folder: New folder for the bag and the logs.
        changes: Values of the experiment by dotted name.
        namespace: Namespace of all nodes.
        ready: Longest wall time until the run begins [s].
        options: Options of a run, such as ``layout``, ``clock``, ``speed`` and ``nodes``; fields of
            `graph.run.RunOptions`.

    Attributes:
        folder: Folder of the bag and the logs.
        outcome: Outcome of the run; None before its end.
        progress: Progress of the run.
    """

    def __init__(
        self,
        experiment: Any,
        folder: Path,
        changes: dict[str, Any] | None = None,
        namespace: str = "",
        ready: float = 60.0,
        **options: Any,
    ):
        self.folder, self.outcome, self.progress = Path(folder), None, None
        self._experiment, self._changes, self._ready = experiment, changes or {}, ready
        self._options = options
        self._namespace, self._end = namespace.strip("/"), False
        self._error: BaseException | None = None

    # ---- start and end

    def __enter__(self) -> Graph:
        from loco_learning.runs.experiment import load

        if isinstance(self._experiment, (str, Path)):
            self._experiment = load(str(self._experiment), self._changes)
        self._join_graph()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()
        try:
            self.expect_event("started", timeout=self._ready)
        except BaseException:
            self.__exit__(GraphError)
            raise
        return self

    def _join_graph(self) -> None:
        from ..client import GraphClient

        self._client = GraphClient("tester")
        self._publishers: dict[str, Any] = {}
        self._heard: dict[str, list[Any]] = {}
        self.listen("events")

    def _run(self) -> None:
        from ..graph import run

        try:
            self.outcome = run.run(
                self._experiment, self.folder, namespace=self._namespace,
                on_progress=self._on_progress, **self._options,
            )  # fmt: skip
        except BaseException as error:  # raised in the test's thread
            self._error = error

    def _on_progress(self, progress: Any) -> bool:
        self.progress = progress
        return self._end

    def __exit__(self, kind: Any = None, *_: object) -> None:
        self._end = True
        self._thread.join()
        self._client.close()
        if kind is None and self._error is not None:
            raise self._error

    def wait_until_done(self, timeout: float = 120.0) -> Any:
        """Wait for the end of the experiment; returns the `Outcome`.

        Raises:
            GraphError: The run failed, or did not end within the time-out.
        """
        self._wait(lambda: not self._thread.is_alive(), timeout, "the end of the run")
        if self._error is not None:
            error, self._error = self._error, None
            raise error
        return self.outcome

    @property
    def exit_codes(self) -> dict[str, int]:
        """Exit code of each process after the run; negative signal number if it was killed."""
        return {} if self.outcome is None else self.outcome.exit_codes

    # ---- topics

    def listen(self, topic: str, type: Any = None) -> list[Any]:  # noqa: A002 (as in rclpy)
        """List that collects the messages of a topic from now on.

        Args:
            topic: Name of the topic.
            type: Message class; not needed for topics of ``docs/topics.md``.
        """
        if topic not in self._heard:
            kind, qos = self._row(topic, type)
            self._heard[topic] = []
            self._client.node.create_subscription(
                kind, self._full(topic), self._heard[topic].append, qos.reader(1000)
            )
        return self._heard[topic]

    def expect(
        self,
        topic: str,
        count: int = 1,
        where: Callable[[Any], bool] = lambda message: True,
        timeout: float = 30.0,
        type: Any = None,  # noqa: A002
    ) -> list[Any]:
        """Wait for messages; returns the matching messages of the topic, at least `count`.

        Args:
            topic: Name of the topic, as for `listen`.
            count: Number of messages to wait for.
            where: Condition that a message must satisfy.
            timeout: Wall time [s].
            type: Message class; not needed for topics of ``docs/topics.md``.

        Raises:
            GraphError: Too few messages arrived, or the run failed.
        """
        messages = self.listen(topic, type)
        self._wait(
            lambda: sum(map(where, messages)) >= count, timeout, f"{count} messages on {topic}"
        )
        return [message for message in messages if where(message)]

    def expect_event(self, kind: str, timeout: float = 30.0) -> Any:
        """Wait for an event, e.g. ``phase`` or ``fall``; returns the first of this kind."""
        return self.expect("events", where=lambda event: event.kind == kind, timeout=timeout)[0]

    def publish(self, topic: str, message: Any, readers: int = 1, timeout: float = 20.0) -> None:
        """Publish a message once at least `readers` subscriptions exist.

        Raises:
            GraphError: There are too few subscriptions within the time-out.
        """
        if topic not in self._publishers:
            kind, qos = self._row(topic, type(message))
            full = self._full(topic)
            node = self._client.node
            self._publishers[topic] = node.create_publisher(kind, full, qos.writer())
        publisher = self._publishers[topic]
        connected = lambda: publisher.get_subscription_count() >= readers  # noqa: E731
        self._wait(connected, timeout, f"{readers} readers of {topic}")
        publisher.publish(message)

    def pid(self, node: str, timeout: float = 20.0) -> int:
        """Pid of a node, from its diagnostics."""
        name = self._full(node).lstrip("/")
        pids: list[int] = []

        def named(array: Any) -> bool:
            pids.extend(
                int(v.value)
                for s in array.status if s.name == name for v in s.values if v.key == "pid"
            )  # fmt: skip
            return bool(pids)

        self.expect("/diagnostics", where=named, timeout=timeout)
        return pids[-1]

    def _full(self, name: str) -> str:
        return name if name.startswith("/") else "/" + f"{self._namespace}/{name}".lstrip("/")

    def _row(self, name: str, kind: Any) -> tuple[Any, Any]:
        """Type and QoS of a topic."""
        from loco_control.ros.messages.joint_topics import TABLES
        from loco_control.ros.messages.topics import STATE

        from ..graph import node_set

        table = TABLES[node_set.table_of(self._options.get("nodes") or self._experiment.node_set)]
        if name in table:
            return table[name].type, table[name].qos
        if kind is None:
            raise GraphError(f"topic {name} is not in our tables; say its type")
        return kind, STATE

    def _wait(self, done: Callable[[], bool], timeout: float, what: str) -> None:
        end = time.monotonic() + timeout
        while not done():
            over = not self._thread.is_alive() if hasattr(self, "_thread") else False
            if over and self._error is not None:
                raise self._error
            if time.monotonic() > end or (over and what != "the end of the run"):
                after = "before the run ended" if over else f"within {timeout:g} s"
                raise GraphError(f"{what} did not come {after}; logs are in {self.folder}/logs")
            self._client.spin(0.05)


# ---- pytest


def pytest_configure(config: Any) -> None:
    """Reserve a domain for this worker, unless one is set already."""
    if os.environ.get("LOCO_TEST_PROCESS") != str(os.getpid()):
        isolate()


@pytest.fixture
def loco_graph(tmp_path: Path) -> Iterator[Callable[..., Graph]]:
    """Function that creates a `Graph` in the temporary folder of the test, with its arguments."""
    graphs: list[Graph] = []

    def make(experiment: Any, **options: Any) -> Graph:
        graphs.append(Graph(experiment, tmp_path / f"graph_{len(graphs)}", **options))
        return graphs[-1]

    yield make
