# SPDX-License-Identifier: Apache-2.0
"""Options of the commands that set loco up."""

from __future__ import annotations

from argparse import ArgumentParser

from .registry import group

command = group("Work on loco itself")


@command("install", "cli.install:install",
         "install what only some commands need: view, rl, lerobot, dynamixel and more")  # fmt: skip
def install(p: ArgumentParser) -> None:
    """Options of `loco install`.

    In a clone `./loco install` installs the versions of its lock file.
    """
    p.add_argument("extra", nargs="+", help="view, foxglove, rl, ppo, mpc, lerobot, dynamixel, "
                   "cluster, ros1, battery, docs, test or ros")  # fmt: skip


@command("completion", "cli.listing:show_completion", "print what makes a shell complete loco: "
         "eval \"$(loco completion bash)\" or zsh")  # fmt: skip
def completion(p: ArgumentParser) -> None:
    """Options of `loco completion`.

    Type one of these once, for bash or zsh:
      echo 'eval "$(loco completion bash)"' >> ~/.bashrc
      echo 'eval "$(loco completion zsh)"' >> ~/.zshrc
    """
    p.add_argument("shell", choices=("bash", "zsh"), help="shell that reads it")
