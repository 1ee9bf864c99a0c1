# SPDX-License-Identifier: Apache-2.0
"""Flowcharts of the pages (``flowchart LR`` of Mermaid) as SVG, since the site runs no Mermaid."""

from __future__ import annotations

import re
from html import escape
from itertools import pairwise

NODE = r'(\w+)(?:\["?([^"\]]*)"?\])?'
EDGE = re.compile(rf'\s*{NODE}\s+(?:-- "?(.*?)"? )?(-->|---)\s+{NODE}\s*$')
CHARACTER, LINE, GAP = 7.0, 74, 34  # width of a character, distance of rows, of columns [pixel]
BOX, ARC = 42, 40  # height of a node, and of an arc per column [pixel]


def svg(text: str) -> str:
    """Picture of a flowchart from left to right, one column per step from the first node.

    A label such as ``robot_sim: surrogate`` has two lines. Frames of subgraphs are not drawn.

    Args:
        text: Lines of Mermaid with edges such as ``a[label] -- text --> b``.
    """
    labels: dict[str, str] = {}
    edges = []
    for a, label_a, words, arrow, b, label_b in _edges(text):
        for node, label in ((a, label_a), (b, label_b)):
            labels[node] = label or labels.get(node, node)
        edges.append((a, b, words, arrow))
    columns = _columns(list(labels), edges)
    x, y, width = _places(labels, columns, edges)
    parts, tops, bottoms = [], [0.0], [max(y.values()) + BOX]
    for a, b, words, arrow in edges:
        span = columns[b] - columns[a]
        start, end = (x[a] + width[a], y[a]), (x[b], y[b])
        bend = [((start[0] + end[0]) / 2, y[a]), ((start[0] + end[0]) / 2, y[b])]
        if span != 1:  # an arc over the nodes between both, or back below them
            side = 1 if span < 1 else -1
            start = (x[a] + width[a] * (0.5 - 0.2 * side), y[a] + side * BOX / 2)
            end = (x[b] + width[b] * (0.5 + 0.2 * side), y[b] + side * BOX / 2)
            far = side * ARC * max(abs(span), 1)
            bend = [(start[0], start[1] + far), (end[0], end[1] + far)]
            tops.append(min(start[1], end[1]) + 0.75 * far - 20)
            bottoms.append(max(start[1], end[1]) + 0.75 * far + 5)
        path = " ".join(f"{px:.0f},{py:.0f}" for px, py in (*bend, end))
        tip = ' marker-end="url(#tip)"' if arrow == "-->" else ""
        parts.append(
            f'<path d="M{start[0]:.0f},{start[1]:.0f} C{path}" fill="none" stroke="gray"{tip}/>'
        )
        at = [sum(w * p[i] for w, p in zip((1, 3, 3, 1), (start, *bend, end), strict=True)) / 8
              for i in (0, 1)]  # fmt: skip
        parts.append(_words(at[0], at[1] - 5, words or ""))
    for node, label in labels.items():
        parts.append(
            f'<rect x="{x[node]:.0f}" y="{y[node] - BOX / 2:.0f}" width="{width[node]:.0f}" '
            f'height="{BOX}" rx="5" fill="none" stroke="currentColor"/>'
        )
        lines = label.split(": ")
        for i, line in enumerate(lines):
            at_y = y[node] + 5 + 16 * (i - (len(lines) - 1) / 2)
            parts.append(_words(x[node] + width[node] / 2, at_y, line))
    right, top = max(x[n] + width[n] for n in labels) + 5, min(tops)
    return (
        f'<figure style="overflow-x: auto"><svg viewBox="0 {top:.0f} {right:.0f} '
        f'{max(bottoms) - top:.0f}" width="{right:.0f}" role="img" font-size="13" '
        'fill="currentColor"><defs><marker id="tip" viewBox="0 0 8 8" refX="8" refY="4" '
        'markerWidth="8" markerHeight="8" orient="auto"><path d="M0,0 L8,4 L0,8 z" fill="gray"/>'
        f"</marker></defs>{''.join(parts)}</svg></figure>"
    )


def _edges(text: str) -> list[tuple[str, ...]]:
    return [match.groups() for line in text.splitlines() if (match := EDGE.match(line))]


def _columns(nodes: list[str], edges: list[tuple[str, ...]]) -> dict[str, int]:
    """Column of each node: the longest path to it without edges that lead back in a cycle."""
    after: dict[str, list[str]] = {n: [b for a, b, *_ in edges if a == n] for n in nodes}
    order: list[str] = []  # every node before those that it leads to

    def visit(node: str, path: tuple[str, ...]) -> None:
        if node not in order and node not in path:
            for b in after[node]:
                visit(b, (*path, node))
            order.insert(0, node)

    for node in nodes:
        visit(node, ())
    columns = dict.fromkeys(nodes, 0)
    for i, node in enumerate(order):
        for b in set(after[node]) & set(order[i + 1 :]):
            columns[b] = max(columns[b], columns[node] + 1)
    return columns


def _places(
    labels: dict[str, str], columns: dict[str, int], edges: list[tuple[str, ...]]
) -> tuple[dict[str, float], dict[str, float], dict[str, float]]:
    """Left edge, middle height and width of each node [pixel]."""
    width = {n: CHARACTER * max(map(len, t.split(": "))) + 20 for n, t in labels.items()}
    rows = [[n for n in labels if columns[n] == c] for c in range(max(columns.values()) + 1)]
    left, x = 2.0, {}
    for c, (here, _) in enumerate(pairwise([*rows, []])):
        x |= dict.fromkeys(here, left)
        words = [w for a, b, w, _ in edges if {columns[a], columns[b]} == {c, c + 1} and w]
        left += max(width[n] for n in here) + GAP + CHARACTER * max(map(len, words), default=0)
    most = max(map(len, rows))
    y = {n: BOX / 2 + 5 + LINE * (i + (most - len(r)) / 2) for r in rows for i, n in enumerate(r)}
    return x, y, width


def _words(x: float, y: float, words: str) -> str:
    return f'<text x="{x:.0f}" y="{y:.0f}" text-anchor="middle">{escape(words)}</text>'
