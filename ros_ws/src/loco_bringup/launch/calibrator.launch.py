# SPDX-License-Identifier: Apache-2.0
"""Start the calibrator node, with its actions ``calibrate`` and ``find_gap``.

ros2 launch loco_bringup calibrator.launch.py folders:="[bags, recordings]"

The node runs until it is stopped and reads recordings only from the folders in `folders`.
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
    """The calibrator node."""
    value = {name: LaunchConfiguration(name).perform(context) for name in ARGUMENTS}
    folders = [str(folder) for folder in yaml.safe_load(value["folders"])]
    return [
        Node(package="loco_bringup", executable="calibrator", name="calibrator",
             namespace=value["namespace"], parameters=[{"folders": folders}], output="screen")
    ]  # fmt: skip


def generate_launch_description():
    """Launch arguments and the node."""
    declared = [
        DeclareLaunchArgument(name, default_value=default, description=text)
        for name, (default, text) in ARGUMENTS.items()
    ]
    return LaunchDescription([*declared, OpaqueFunction(function=nodes)])
