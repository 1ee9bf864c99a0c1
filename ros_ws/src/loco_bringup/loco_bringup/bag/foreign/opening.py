# SPDX-License-Identifier: Apache-2.0
"""Open a recording of any recorder as a `Bag`."""

from __future__ import annotations

from pathlib import Path

from loco_control.exceptions import BagError
from loco_learning.gap.importing.tables import is_table

from ..coding import plain_name
from ..reader import Bag
from . import ros1, sqlite

BAG_TYPES = {".mcap": Bag, sqlite.SUFFIX: sqlite.SqliteBag, ros1.SUFFIX: ros1.Ros1Bag}


def suffix_of(path: Path) -> str:
    """Extension of a bag's files, one of `BAG_TYPES`; empty if the path is no bag.

    Args:
        path: File, or folder of a bag.
    """
    names = [path.name] if not path.is_dir() else [file.name for file in path.iterdir()]
    endings = {Path(plain_name(name)).suffix for name in names}
    return next((end for end in BAG_TYPES if end in endings), "")


def name_of(path: Path) -> str:
    """Name of a recording: its folder, or its file without endings if it was given as a file."""
    path = path.resolve()
    return path.name if path.is_dir() else Path(plain_name(path.name).removesuffix(".gz")).stem


def result_path(path: Path, name: str) -> Path:
    """Default path of a result: in the folder of a bag, or beside a file and after its name."""
    if path.is_dir() or not path.is_file():
        return path / name
    has_own_folder = (path.parent / "metadata.yaml").is_file() or path.suffix == ".mcap"
    return path.parent / (name if has_own_folder else f"{name_of(path)}_{name}")


def open_bag(path: str | Path) -> Bag:
    """The bag at a path: MCAP, SQLite or ROS 1, compressed or not.

    Args:
        path: Folder of a bag, or one of its files.

    Raises:
        MissingFileError: There is no bag at the path.
        BagError: The bag is damaged, or a table.
        MissingPackageError: It is a ROS 1 bag, and rosbags is not installed.
    """
    if Path(path).is_file() and is_table(Path(path)):
        raise BagError(f"{path} is a table and no bag; `loco report` and `loco gap check` read it")
    return BAG_TYPES.get(suffix_of(Path(path)), Bag)(path)
