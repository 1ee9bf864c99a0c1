# SPDX-License-Identifier: Apache-2.0
from setuptools import find_packages, setup

setup(
    name="loco_learning",
    version="0.2.0",
    description="Reflex network trained by FORCE, experiments, rollouts, metrics and studies",
    license="Apache-2.0",
    packages=find_packages(include=["loco_learning*"]),
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
        ("share/ament_index/resource_index/packages", ["resource/loco_learning"]),
        ("share/loco_learning", ["package.xml"]),
    ],
    entry_points={
        "console_scripts": [
            "reflex_network = loco_learning.ros.reflex_node:main",
            "joint_reflex = loco_learning.ros.joint_reflex_node:main",
            "msd_reflex = loco_learning.ros.msd_reflex_node:main",
        ]
    },
    zip_safe=False,
)
