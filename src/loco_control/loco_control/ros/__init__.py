# SPDX-License-Identifier: Apache-2.0
"""ROS 2 nodes of loco_control and their base classes; no module outside of this folder imports ROS.

Every process that creates a node imports this package first, so here the traffic of the graph is
restricted to this machine: rclpy and Fast DDS read these variables at the first node.
"""

import logging
import os
from collections.abc import MutableMapping
from pathlib import Path

RANGE = "ROS_AUTOMATIC_DISCOVERY_RANGE"
PROFILE = "FASTRTPS_DEFAULT_PROFILES_FILE"
IGNORE_OWN = "LOCO_IGNORE_OWN_ENDPOINTS"  # in the profiles: ignore own endpoints
LOOPBACK = str(Path(__file__).with_name("loopback.xml"))  # binds only 127.0.0.1 and shared memory
OPEN = str(Path(__file__).with_name("open.xml"))
_RANGES = ("", "LOCALHOST", "SYSTEM_DEFAULT", "OFF")  # legal values in addition to SUBNET
_OPENS = f"the graph stays on this machine unless {RANGE} is SUBNET"
# Variables that would open connections to other machines.
_REACHING = ("ROS_STATIC_PEERS", "ROS_DISCOVERY_SERVER", "FASTDDS_ENVIRONMENT_FILE")


def settle_network(env: MutableMapping[str, str]) -> list[str]:
    """Restrict the traffic of a graph to this machine unless `RANGE` is SUBNET.

    DDS then binds only 127.0.0.1 and shared memory. rmw_fastrtps itself would bind all addresses
    for LOCALHOST, so the range becomes SYSTEM_DEFAULT, which leaves the addresses to the profile.
    A profile set by the user takes precedence over both.

    Args:
        env: Environment variables, changed in place; at import those of this process.

    Returns:
        Lines for the user, one for each variable that is ignored or takes precedence.
    """
    env["SKIP_DEFAULT_XML_FILE"] = "1"  # ignore a profile that happens to lie in the current folder
    env[IGNORE_OWN] = "false"
    middleware, profile = env.get("RMW_IMPLEMENTATION", ""), env.get(PROFILE, "")
    if middleware and not middleware.startswith("rmw_fastrtps"):
        env[RANGE] = env.get(RANGE) or "LOCALHOST"
        return [f"RMW_IMPLEMENTATION is {middleware[:40]}: it decides what addresses are bound"]
    if has_user_profile(env):
        env[RANGE] = env.get(RANGE) or "LOCALHOST"
        return [f"{PROFILE} is {profile[-160:]}: that profile decides what addresses are bound"]
    scope = env.get(RANGE, "")
    if scope == "SUBNET" and env.get("ROS_LOCALHOST_ONLY") != "1":
        env[PROFILE] = OPEN
        return []
    lines = [f"{name} is ignored; {_OPENS}" for name in _REACHING if env.pop(name, "")]
    only_here = env.pop("ROS_LOCALHOST_ONLY", "")  # it would make rmw_fastrtps bind all addresses
    if scope == "SUBNET":
        lines.append(f"ROS_LOCALHOST_ONLY={only_here} keeps the graph here in spite of SUBNET")
    elif scope not in _RANGES:
        lines.append(f"{RANGE}={scope[:40]} is ignored; {_OPENS}")
    env[PROFILE], env[RANGE] = LOOPBACK, "OFF" if scope == "OFF" else "SYSTEM_DEFAULT"
    return lines


def has_user_profile(env: MutableMapping[str, str]) -> bool:
    """Whether a Fast DDS profile is set that does not belong to any copy of loco."""
    path = Path(env.get(PROFILE) or LOOPBACK)
    return (path.parts[-3:-1], path.name) not in (
        (("loco_control", "ros"), Path(profile).name) for profile in (LOOPBACK, OPEN)
    )


for _line in settle_network(os.environ):
    logging.getLogger(__name__).warning("%s", _line)
