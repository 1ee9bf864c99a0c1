# SPDX-License-Identifier: Apache-2.0
from glob import glob

from setuptools import find_packages, setup

setup(
    name="loco_bringup",
    version="0.2.0",
    description="Node sets, command line, recorder, replayer and report",
    license="Apache-2.0",
    packages=find_packages(include=["loco", "loco_bringup*"]),
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
        ("share/ament_index/resource_index/packages", ["resource/loco_bringup"]),
        ("share/loco_bringup", ["package.xml"]),
        ("share/loco_bringup/launch", glob("launch/*.launch.py")),
    ],
    entry_points={
        "console_scripts": [
            "loco = loco_bringup.cli.main:main",
            "calibrator = loco_bringup.live.calibrator:main",
            "recorder = loco_bringup.record.recorder:main",
            "replayer = loco_bringup.record.replayer:main",
        ]
    },
    zip_safe=False,
)
