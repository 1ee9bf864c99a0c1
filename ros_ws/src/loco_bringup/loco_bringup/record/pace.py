# SPDX-License-Identifier: Apache-2.0
"""Timing of a replay: speed, pause, single steps, and the keys that control them."""

from __future__ import annotations

import contextlib
import os
import select
import sys
import termios
import time
import tty
from collections.abc import Callable

from loco_control.exceptions import ParameterError

_SLICE = 0.05  # longest wait between two checks for keys and commands [s]
KEYS = {" ": "toggle", "s": "step", "+": "faster", "-": "slower", "q": "quit"}


class Keys:
    """Reader of single key presses in the terminal, without Enter; inactive without a terminal."""

    def __enter__(self) -> Keys:
        self._fd = sys.stdin.fileno() if _is_terminal() else -1
        if self._fd >= 0:
            self._before = termios.tcgetattr(self._fd)
            tty.setcbreak(self._fd)
        return self

    def pressed(self) -> str:
        """Key pressed since the last call; empty if none."""
        if self._fd < 0 or not select.select([self._fd], [], [], 0.0)[0]:
            return ""
        return os.read(self._fd, 1).decode(errors="ignore")

    def __exit__(self, *_: object) -> None:
        if self._fd >= 0:
            termios.tcsetattr(self._fd, termios.TCSADRAIN, self._before)


def _is_terminal() -> bool:
    with contextlib.suppress(OSError, ValueError, AttributeError):
        return os.isatty(sys.stdin.fileno()) and os.isatty(sys.stderr.fileno())
    return False


class Pace:
    """Delay of messages until they are due.

    Args:
        speed: Multiple of real time, 0 for no limit.
        paused: Whether the replay starts paused.
        keys: Source of pressed keys; None without a terminal.

    Attributes:
        over: Whether the command quit was given.
    """

    def __init__(self, speed: float = 1.0, paused: bool = False, keys: Keys | None = None):
        self._speed, self._paused, self._keys = speed, paused, keys
        self._steps = 0
        self._newest: float | None = None  # time of the newest released message
        self._anchor: tuple[float, float] | None = None  # reference wall time and message time
        self.over = False

    def begin(self) -> None:
        """Reset the timing at the start of the bag."""
        self._newest = self._anchor = None

    def command(self, text: str) -> None:
        """Execute a command: pause, resume, toggle, step [N], speed X, faster, slower or quit.

        Raises:
            ParameterError: The command is unknown.
        """
        verb, _, value = text.strip().partition(" ")
        self._anchor = None
        try:
            if verb in ("pause", "resume", "toggle"):
                self._paused = verb == "pause" or (verb == "toggle" and not self._paused)
            elif verb == "step":
                self._paused, self._steps = True, self._steps + int(value or 1)
            elif verb == "speed" and float(value) >= 0.0:
                self._speed = float(value)
            elif verb in ("faster", "slower"):
                self._speed *= 2.0 if verb == "faster" else 0.5
            elif verb == "quit":
                self.over = True
            else:
                raise ValueError
        except ValueError:
            raise ParameterError(
                "a replay knows pause, resume, toggle, step [N], speed X (0 or more), faster, "
                f"slower and quit; got {text!r}"
            ) from None

    def wait(self, t: float, on_wait: Callable[[float], None]) -> bool:
        """Wait until the message of time `t` [s] is due; returns False after the command quit.

        Args:
            t: Seconds from the start of the bag.
            on_wait: Called with a remaining time [s], in short slices; it may receive commands.
        """
        while True:
            key = self._keys.pressed() if self._keys else ""
            if key in KEYS:
                self.command(KEYS[key])
            if self.over:
                return False
            remaining = self._left(t)
            if remaining <= 0.0:
                self._newest = t
                return True
            on_wait(min(remaining, _SLICE))

    def _left(self, t: float) -> float:
        """Wall time until a message is due [s]; one step covers all messages of the same time."""
        if self._paused:
            if t == self._newest:
                return 0.0
            if self._steps:
                self._steps -= 1
                return 0.0
            return _SLICE
        if not self._speed:
            return 0.0
        time_now = time.perf_counter()
        if self._anchor is None:
            self._anchor = (time_now, t if self._newest is None else self._newest)
        return self._anchor[0] + (t - self._anchor[1]) / self._speed - time_now
