# SPDX-License-Identifier: Apache-2.0
from setuptools import find_packages, setup

setup(
    name="loco_sim",
    version="0.2.0",
    description="PyBullet plant of a quadruped with its effects and sensors, as a ROS 2 node",
    license="Apache-2.0",
    packages=find_packages(include=["loco_sim*"]),
    package_data={
        "": [
            f"**/*.{kind}"
            for kind in (
                "yaml",
                "urdf",
                "csv",
                "html",
                "j2",
                "css",
                "js",
                "svg",
                "xml",
                "msg",
                "json",
                "rviz",
                "txt",
            )
        ]
    },
    data_files=[
        ("share/ament_index/resource_index/packages", ["resource/loco_sim"]),
        ("share/loco_sim", ["package.xml"]),
    ],
    entry_points={
        "console_scripts": [
            "robot_sim = loco_sim.ros.sim_node:main",
            "joint_sim = loco_sim.ros.joint_sim_node:main",
            "msd_sim = loco_sim.ros.msd_sim_node:main",
            "driver = loco_sim.ros.driver_node:main",
        ]
    },
    zip_safe=False,
)
