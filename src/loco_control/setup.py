# SPDX-License-Identifier: Apache-2.0
from setuptools import find_packages, setup

setup(
    name="loco_control",
    version="0.2.0",
    description="Gait generator, stance estimate and trunk control of a quadruped",
    license="Apache-2.0",
    packages=find_packages(include=["loco_control*"]),
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
        ("share/ament_index/resource_index/packages", ["resource/loco_control"]),
        ("share/loco_control", ["package.xml"]),
    ],
    entry_points={
        "console_scripts": [
            "target_generator = loco_control.ros.target_node:main",
            "stance_controller = loco_control.ros.stance_node:main",
            "cpg = loco_control.ros.cpg_node:main",
            "faults = loco_control.ros.fault_node:main",
        ]
    },
    zip_safe=False,
)
