# SPDX-License-Identifier: Apache-2.0
"""Two machines with a cable between them: network namespaces with a /dev/shm of their own.

Nothing leaves them: they have no other link, and end with the processes that hold them.
"""

import contextlib
import json
import os
import subprocess
import sys
from pathlib import Path

BAIT = "/bait"  # topic of a node that does not hide
ROBOT, OTHER = "10.213.7.1", "10.213.7.2"  # exist inside the two namespaces only
_HOLD = "mount -t tmpfs tmpfs /dev/shm && ip link set lo up && echo up && exec sleep 3600"
_OF_NETWORK = ("ROS_", "FASTRTPS_", "FASTDDS_", "LOCO_IGNORE", "SKIP_DEFAULT", "_ROS_WHEELS")


class Unavailable(Exception):
    """Namespaces cannot be made here; the text says why."""


def environment(**more):
    """The environment of this process without what DDS is told in it."""
    clean = {k: v for k, v in os.environ.items() if not k.startswith(_OF_NETWORK)}
    return {**clean, "ROS_DOMAIN_ID": "77", **more}


class Machine:
    """One of the two.

    Args:
        holder: Process that holds its namespaces.
    """

    def __init__(self, holder):
        self.holder = holder
        self._enter = ["nsenter", "-t", str(holder.pid), "-U", "-n", "-m", "--preserve-credentials"]

    def start(self, *command, env, **more):
        """Start a program on it, with `env` as the environment."""
        return subprocess.Popen([*self._enter, *command], env=env, **more)

    def run(self, *command):
        """Run a program on it to its end."""
        subprocess.run([*self._enter, *command], check=True, capture_output=True, timeout=60)

    def bound(self):
        """Addresses that UDP and TCP sockets on it are bound to, as the kernel writes them."""
        rows = [
            line.split()[1].partition(":")[0]
            for kind in ("udp", "udp6", "tcp", "tcp6")
            for line in Path(f"/proc/{self.holder.pid}/net/{kind}").read_text().splitlines()[1:]
        ]
        return set(rows)


@contextlib.contextmanager
def two_machines():
    """The robot's machine, which is ROBOT, and another, which is OTHER, on one cable.

    Raises:
        Unavailable: This system does not let us make namespaces.
    """
    holders = []

    def hold(*command):
        try:
            holder = subprocess.Popen(
                [*command, "--net", "--mount", "sh", "-c", _HOLD],
                stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
            )  # fmt: skip
        except OSError as error:
            raise Unavailable(f"{error.filename}: {error.strerror}") from error
        holders.append(holder)
        if holder.stdout.readline() != "up\n":
            raise Unavailable(f"no namespaces here: {holder.communicate()[1].strip()}")
        return Machine(holder)

    try:
        robot = hold("unshare", "--user", "--map-root-user")
        users = ["nsenter", "-t", str(robot.holder.pid), "-U", "--preserve-credentials"]
        other = hold(*users, "unshare")
        pid = str(other.holder.pid)
        try:
            robot.run("ip", "link", "add", "cable", "type", "veth", "peer", "cable", "netns", pid)
            for machine, address in ((robot, ROBOT), (other, OTHER)):
                machine.run("ip", "address", "add", f"{address}/24", "dev", "cable")
                machine.run("ip", "link", "set", "cable", "up")
                machine.run("ip", "route", "add", "default", "dev", "cable")
        except (subprocess.CalledProcessError, OSError) as error:
            raise Unavailable(f"no cable here: {getattr(error, 'stderr', error)}") from error
        yield robot, other
    finally:
        for holder in holders:
            holder.kill()
            holder.communicate()


# ---- what the other machine does

PEERS = """<?xml version="1.0" encoding="UTF-8"?>
<dds xmlns="http://www.eprosima.com/XMLSchemas/fastRTPS_Profiles"><profiles>
  <participant profile_name="peers" is_default_profile="true"><rtps><builtin><initialPeersList>
{locators}  </initialPeersList></builtin></rtps></participant>
</profiles></dds>
"""
_PEER = "<locator><udpv4><address>{}</address><port>{}</port></udpv4></locator>\n"


def ways(folder, domain=77):
    """Environments in which a stranger finds a graph on ROBOT, by the name of the way."""
    ports = [7400 + 250 * domain + k for k in (0, *range(10, 10 + 2 * 32))]
    profile = Path(folder) / "peers.xml"
    profile.write_text(PEERS.format(locators="".join(_PEER.format(ROBOT, p) for p in ports)))
    scope = "ROS_AUTOMATIC_DISCOVERY_RANGE"
    return {
        "multicast": {scope: "SUBNET"},
        "static peers": {scope: "SUBNET", "ROS_STATIC_PEERS": ROBOT},
        "static peers alone": {scope: "LOCALHOST", "ROS_STATIC_PEERS": ROBOT},
        "initial peers": {scope: "SYSTEM_DEFAULT", "FASTRTPS_DEFAULT_PROFILES_FILE": str(profile)},
    }


def bait(machine):
    """Start a node that the other machine can see, so that it is known to look long enough."""
    return machine.start(
        sys.executable, __file__, "be seen",
        env=environment(ROS_AUTOMATIC_DISCOVERY_RANGE="SUBNET"),
    )  # fmt: skip


def attack(machine, env, until):
    """Look, read and stop from a machine, until it has what it waits for and 3 s more.

    Args:
        machine: Machine of the attacker.
        env: Environment variables that say how it looks for others.
        until: BAIT, or "stopped": /joint_states was read and the emergency stop has a reader.

    Returns:
        Topics that it saw, number of messages of /joint_states that it read, and readers of its
        emergency stop.
    """
    process = machine.start(
        sys.executable, str(Path(__file__)), until, env=environment(**env),
        stdout=subprocess.PIPE, text=True,
    )  # fmt: skip
    out, _ = process.communicate(timeout=200)
    assert process.returncode == 0, out
    return json.loads(out.splitlines()[-1])


def _be_seen():
    """A node that others may see, until a signal."""
    import signal

    import rclpy

    rclpy.init()
    node = rclpy.create_node("bait")
    node.create_publisher(_flag(), BAIT, 1)
    signal.sigwait({signal.SIGTERM})


def _flag():
    from std_msgs.msg import Bool

    return Bool


def _stranger(until):
    import time

    import rclpy
    from sensor_msgs.msg import JointState

    rclpy.init()
    node, read = rclpy.create_node("stranger"), []
    node.create_subscription(JointState, "/joint_states", read.append, 10)
    stop, most, topics = node.create_publisher(_flag(), "/estop", 10), 0, set()
    end = None
    while end is None or time.monotonic() < end:
        stop.publish(_flag()(data=True))
        rclpy.spin_once(node, timeout_sec=0.05)
        topics |= {name for name, _ in node.get_topic_names_and_types()}
        most = max(most, stop.get_subscription_count())
        if end is None and (until in topics if until == BAIT else read and most):
            end = time.monotonic() + 3.0
    topics -= {"/joint_states", "/estop", "/parameter_events", "/rosout", BAIT}  # its own
    print(json.dumps({"topics": sorted(topics), "read": len(read), "stops": most}))


if __name__ == "__main__":
    _be_seen() if sys.argv[1] == "be seen" else _stranger(sys.argv[1])
