# SPDX-License-Identifier: Apache-2.0
"""The calibrator under ``ros2 launch``: its actions ``calibrate`` and ``find_gap``.

ros2 launch loco_bringup calibrator.launch.py folders:="[bags, recordings]"

It listens until it is stopped, and reads recordings below `folders` only.
"""

import yaml
from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, OpaqueFunction
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

ARGUMENTS = {
    "folders": ("[bags]", "folders below which goals may name recordings"),
    "namespace": ("", "namespace of the node"),
}


def nodes(context):
    """The calibrator."""
    value = {name: LaunchConfiguration(name).perform(context) for name in ARGUMENTS}
    folders = [str(folder) for folder in yaml.safe_load(value["folders"])]
    return [
        Node(package="loco_bringup", executable="calibrator", name="calibrator",
             namespace=value["namespace"], parameters=[{"folders": folders}], output="screen")
    ]  # fmt: skip


def generate_launch_description():
    """Arguments, then the node."""
    declared = [
        DeclareLaunchArgument(name, default_value=default, description=text)
        for name, (default, text) in ARGUMENTS.items()
    ]
    return LaunchDescription([*declared, OpaqueFunction(function=nodes)])
