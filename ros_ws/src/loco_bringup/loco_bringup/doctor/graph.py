# SPDX-License-Identifier: Apache-2.0
"""Checks of `loco doctor` on a running graph: each examines a `View` and returns findings."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Iterator

from loco_control.exceptions import LocoError
from loco_control.ros.messages.definitions import type_hash
from loco_control.ros.messages.joint_topics import TABLES
from loco_control.ros.messages.topics import Topic

from ..graph import process_info
from ..graph.view import Endpoint, View
from .environment import Finding

MUTE = "runs but does not answer"
_STOPPED = {"T": "is stopped (SIGSTOP)", "t": "is held by a debugger", "Z": "is dead"}
_SLOW_SHARE = 0.95  # real-time factor below which the clock realtime is not met


def check_graph(view: View) -> list[Finding]:
    """All faults of the observed graphs, worst first."""
    if not view.endpoints and not view.reports and not view.processes:
        domain = os.environ.get("ROS_DOMAIN_ID", "0")
        text = f"nobody is on ROS domain {domain}"
        return [Finding("no graph", text, "start one with loco run, or see the domain above")]
    checks: list[Callable[[View], Iterable[Finding]]] = [
        check_types, check_qos, check_writers, check_endpoints, check_answers,
        check_ticks, check_plants, check_reports, check_events,
    ]  # fmt: skip
    findings = [finding for check in checks for finding in check(view)]
    if any(finding.fault == "ticks" for finding in findings):  # then every waiting node reports it
        findings = [f for f in findings if f.fault != "warning" or ": silence" not in f.text]
    return sorted(dict.fromkeys(findings), key=lambda finding: not finding.grave)


# ---- expected topics


def tables(view: View) -> dict[str, dict[str, Topic]]:
    """Best matching topic table of each namespace in which a graph runs."""
    result = {}
    for space in view.namespaces():
        pairs = {(e.topic, e.node.rpartition("/")[2]) for e in view.endpoints}
        scores = {
            name: sum(
                (full(space, r.name), w) in pairs for r in _paced(t) for w in (r.writer, *r.readers)
            )
            for name, t in TABLES.items()
        }
        best = max(scores, key=lambda name: scores[name])
        if scores[best] >= 2:
            result[space] = TABLES[best]
    return result


def full(space: str, name: str) -> str:
    """Full name of a topic of a namespace."""
    return name if name.startswith("/") else "/" + "/".join(filter(None, (space, name)))


def _paced(table: dict[str, Topic]) -> list[Topic]:
    return [row for row in table.values() if row.paced]


# ---- the checks


def check_types(view: View) -> Iterator[Finding]:
    """Topics with several types, or with a definition of a loco message that differs."""
    for name in sorted({e.topic for e in view.endpoints}):
        endpoints = [e for e in view.endpoints if e.topic == name]
        types = sorted({e.type for e in endpoints})
        if len(types) > 1:
            who = "; ".join(f"{k}: {_names(e for e in endpoints if e.type == k)}" for k in types)
            text = f"{name} has {len(types)} types, so its ends never meet: {who}"
            yield Finding("type", text, "use one type")
            continue
        unknown = [e for e in endpoints if not _is_known(e)]
        if unknown:
            text = f"{_names(unknown)} has another definition of {types[0]} on {name} than we have"
            yield Finding("messages mismatched", text, "build the same messages there")


def _is_known(end: Endpoint) -> bool:
    if not end.type.startswith("loco_msgs/msg/"):
        return True
    try:
        return end.hash == type_hash(end.type)
    except LocoError:
        return False


def check_qos(view: View) -> Iterator[Finding]:
    """Writers whose QoS is incompatible with that of a reader."""
    for reader in (e for e in view.endpoints if not e.writes):
        for writer in view.of(reader.topic, True):
            if writer.type != reader.type:
                continue
            mismatches = []
            if reader.reliable and not writer.reliable:
                mismatches.append("reliable, which it is not (best effort)")
            if reader.latched and not writer.latched:
                mismatches.append("transient local, which it is not (volatile)")
            if mismatches:
                text = f"{reader.topic}: {reader.node} wants {writer.node} to be {mismatches[0]}"
                yield Finding("QoS", text, "give the writer the QoS of docs/topics.md")


def check_writers(view: View) -> Iterator[Finding]:
    """Topics with several writers: two graphs in one domain and namespace."""
    for space, table in tables(view).items():
        for row in _paced(table):
            writers = view.of(full(space, row.name), True)
            if len(writers) > 1:
                who = ", ".join(f"{w.node} (pid {w.pid})" for w in writers)
                text = f"{full(space, row.name)} has {len(writers)} writers: {who}"
                remedy = "end one of them, or give it another ROS_DOMAIN_ID or namespace"
                yield Finding("domain clash", text, remedy)


def check_endpoints(view: View) -> Iterator[Finding]:
    """Missing writers and readers of the topic table."""
    missing: dict[str, list[str]] = {}
    for space, table in tables(view).items():
        nodes = {e.node for e in view.endpoints}
        for row in _paced(table):
            for node, writes in ((row.writer, True), *((r, False) for r in row.readers)):
                who, name = "/".join(filter(None, (space, node))), full(space, row.name)
                if node == "any" or any(e.node == who for e in view.of(name, writes)):
                    continue
                what = "does not write" if writes else "does not read"
                if who not in nodes and who in view.processes:
                    continue  # its process runs but does not answer; see `check_answers`
                key = f"{who} {what}" if who in nodes else f"{who} is missing: nobody"
                verb = "" if who in nodes else ("writes " if writes else "reads ")
                missing.setdefault(key, []).append(verb + name)
    for key, names in missing.items():
        text = f"{key} {', '.join(names)}"
        yield Finding("missing endpoint", text, "start the node, see its log")


def check_answers(view: View) -> Iterator[Finding]:
    """Nodes without a recent diagnostic report."""
    loco_nodes = {e.node for e in view.endpoints if e.topic == "/diagnostics" and e.writes}
    for node in sorted(loco_nodes | view.reports.keys() | view.processes.keys()):
        report = view.reports.get(node)
        if report is not None and report.age < view.silent:
            continue
        pid = view.pid(node) or (int(report.number("pid")) if report else 0)
        state = _state(pid)
        since = f"for {report.age:.0f} s" if report else "at all"
        text = f"{node} (pid {pid or 'unknown'}) {state}; it has not spoken {since}"
        remedy = f"kill -CONT {pid}" if "SIGSTOP" in state else "see its log, start it again"
        yield Finding("node silent", text, remedy)


def _state(pid: int) -> str:
    letter = process_info.state(pid)
    return _STOPPED.get(letter, MUTE) if letter else "is gone (killed or crashed)"


def check_ticks(view: View) -> Iterator[Finding]:
    """Plants that do not advance, and the nodes they wait for."""
    for name, report in view.reports.items():
        if name.rpartition("/")[2] != "robot_sim" or report.age >= view.silent:
            continue
        waits = report.values.get("waiting for nodes")
        if waits:
            text = f"{name} has not begun: {waits} never said that it is ready"
            yield Finding("not ready", text, "see the logs of these nodes")
        elif report.number("silence") >= 2.0:
            space = name.rpartition("/")[0]
            culprit = _blame(view, space, tables(view).get(space, {}), name, set())
            at = f"tick {report.values.get('tick', '?')}"
            text = f"{name} has waited {report.number('silence'):.0f} s at {at}: {culprit}"
            yield Finding("ticks", text, "see the log of the last node named")


def _blame(view: View, space: str, table: dict[str, Topic], node: str, visited: set[str]) -> str:
    """Chain of nodes that wait for each other, from `node` to the one that causes the wait."""
    visited.add(node)
    missing = [m for m in view.reports[node].values.get("missing", "").split(", ") if m]
    for name in missing:
        row = table.get(name)
        writer = "/".join(filter(None, (space, row.writer))) if row else ""
        report = view.reports.get(writer)
        if report is None or report.age >= view.silent:
            pid = view.pid(writer) or (int(report.number("pid")) if report else 0)
            return f"{name} does not come from {writer or 'its writer'}, which {_state(pid)}"
        inputs = [r.name for r in _paced(table) if row.writer in r.readers]
        waits = [m for m in report.values.get("missing", "").split(", ") if m]
        if waits and set(waits) != set(inputs) and writer not in visited:
            return (
                f"{name} does not come from {writer}; {_blame(view, space, table, writer, visited)}"
            )
    return f"{', '.join(missing) or 'a command'} does not come, though its writer waits for nothing"


def check_plants(view: View) -> Iterator[Finding]:
    """Time-outs, latched emergency stops, and plants slower than their real-time clock."""
    for name, report in view.reports.items():
        if name.rpartition("/")[2] != "robot_sim" or report.age >= view.silent:
            continue
        late, factor = report.number("late_share"), report.number("real_time_factor", 1.0)
        if report.values.get("estop"):
            text = f"{name} is in emergency stop: {report.values['estop']}"
            yield Finding("emergency stop", text, "loco estop --reset")
        if late >= 0.05:
            text = f"{name} got no fresh command in {100 * late:.0f} % of its ticks"
            remedy = "find the slow node in loco top, or lower the load"
            yield Finding("time-out", text, remedy)
        if report.values.get("clock") == "realtime" and factor < _SLOW_SHARE:
            text = f"{name} runs at {factor:.2f} x real time with the clock realtime"
            yield Finding("real-time factor", text, "lower the load of the machine")


def check_reports(view: View) -> Iterator[Finding]:
    """Warnings in the diagnostic reports of nodes."""
    for name, report in view.reports.items():
        waits = report.message == "waiting for endpoints"
        if report.level and report.age < view.silent and not waits:
            text = f"{name}: {report.message}"
            yield Finding("warning", text, "see its log", grave=report.level > 1)


def check_events(view: View) -> Iterator[Finding]:
    """Errors, falls and refusals among the published events."""
    for e in view.events:
        if e.kind in ("error", "fall", "model refused"):
            node = "/".join(filter(None, (e.namespace, e.node)))
            text = f"{node} at {e.time:.2f} s: {e.text}"
            yield Finding(e.kind, text, "start the run again", grave=e.kind != "model refused")


def _names(endpoints: object) -> str:
    return ", ".join(sorted({e.node for e in endpoints}))
