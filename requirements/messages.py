# SPDX-License-Identifier: Apache-2.0
"""The messages of `src/*_msgs` for Python: compiled ones that are shipped, or a build of them.

`messages.zip` holds what the build installs, less what only compilers read, for each CPython by
the name of its binary interface (`cpython-311-x86_64-linux-gnu`); `all` holds the files that are
the same for every one. `key` is the digest of what they were made from: other sources or other
generators make another one, and then the messages are built, as they are on other platforms.

    python requirements/messages.py check      say why the shipped ones will not do; 0 if they will
    .venv/bin/python requirements/messages.py install    put them into .venv
    .venv/bin/python requirements/messages.py build      build them into .venv
    python3.11 requirements/messages.py pack python3.10 python3.11 ...    make messages.zip anew
"""

from __future__ import annotations

import hashlib
import os
import re
import shutil
import subprocess
import sys
import sysconfig
import tempfile
import zipfile
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
SHIPPED = ROOT / "requirements/messages.zip"
PACKAGES = ("tf2_msgs", "loco_msgs")
SOURCES = ("CMakeLists.txt", "package.xml", "cmake/*.cmake", "msg/*.msg", "action/*.action")
KEPT = re.compile(  # of what is installed; the rest is for compilers and shells
    r"lib/lib\w+\.so|site-packages/.*(\.py|_s__rosidl_typesupport_c\.so)|share/\w+/(msg|action)/.*|"
    r"share/\w+/package\.xml|share/ament_index/resource_index/(packages|rosidl_interfaces)/\w+"
)


def key(root: Path = ROOT) -> str:
    """Digest of what the messages are made from: sources, and the versions of ROS's packages.

    Args:
        root: Folder of the repository.
    """
    digest = hashlib.sha256()
    for pattern in SOURCES:
        for path in sorted(root.glob(f"src/*_msgs/{pattern}")):
            digest.update(f"{path.relative_to(root).as_posix()}\n".encode() + path.read_bytes())
    for lock in ("lock.txt", "build.txt"):
        text = (root / "requirements" / lock).read_text()
        digest.update("\n".join(re.findall(r"(?m)^(?:ros-|empy)\S+", text)).encode())
    return digest.hexdigest()


def check(shipped: Path = SHIPPED, root: Path = ROOT) -> str:
    """Reason why the shipped messages will not do for this Python; empty if they will.

    Args:
        shipped: The archive.
        root: Folder of the repository.
    """
    if os.environ.get("LOCO_COMPILE"):
        return "LOCO_COMPILE is set"
    if not zipfile.is_zipfile(shipped):
        return f"{shipped.name} is missing or damaged"
    with zipfile.ZipFile(shipped) as archive:
        if archive.read("key").decode() != key(root):
            return f"{shipped.name} was made from other messages or by other generators"
        if not any(name.startswith(f"{abi()}/") for name in archive.namelist()):
            return f"{shipped.name} has none for {abi()}"
    return ""


def abi() -> str:
    """Name of the binary interface of this Python."""
    return str(sysconfig.get_config_var("SOABI"))


def install(prefix: Path, site: Path, shipped: Path = SHIPPED) -> None:
    """Put the shipped messages into an environment, in place of those that are there.

    Args:
        prefix: Folder of the environment.
        site: Its folder of Python packages.
        shipped: The archive.
    """
    clear(prefix, site)
    with zipfile.ZipFile(shipped) as archive:
        for member in archive.namelist():
            folder, _, name = member.partition("/")
            if folder in ("all", abi()):
                inside = name.removeprefix("site-packages/")
                path = prefix / name if inside == name else site / inside
                path.parent.mkdir(parents=True, exist_ok=True)
                path.write_bytes(archive.read(member))


def clear(prefix: Path, site: Path) -> None:
    """Remove messages, which may have had other names, from an environment.

    Args:
        prefix: Folder of the environment.
        site: Its folder of Python packages.
    """
    for package in PACKAGES:
        for path in [*site.glob(f"{package}*"), prefix / "share" / package]:
            shutil.rmtree(path, ignore_errors=True)
        for path in prefix.glob(f"lib/lib{package}__*.so"):
            path.unlink()


def build(prefix: Path, site: Path) -> int:
    """Build the messages into an environment; the exit code is 0, or that of a build that failed.

    Args:
        prefix: Folder of the environment, whose packages generate the sources.
        site: Its folder of Python packages.
    """
    clear(prefix, site)
    with tempfile.TemporaryDirectory(prefix="messages", dir=prefix) as folder:
        places = {package: Path(folder, package) for package in PACKAGES}
        return (
            run(*(configure(prefix, *item) for item in places.items()))
            or run(*(cmake(prefix, "--build", str(place)) for place in places.values()))
            or run(*(cmake(prefix, "--install", str(p), "--strip") for p in places.values()))
        )


def configure(prefix: Path, package: str, place: Path) -> list[str]:
    """Command that prepares the build of a package in a folder."""
    # No path of this machine gets into what is built.
    mapped = (str(place), sysconfig.get_path("include"))
    flags = " ".join(["-O1", *(f"-ffile-prefix-map={folder}=." for folder in mapped)])
    return cmake(
        prefix, "-G", "Ninja", "-S", str(ROOT / "src" / package), "-B", str(place),
        f"-DCMAKE_MAKE_PROGRAM={prefix}/bin/ninja", f"-DCMAKE_INSTALL_PREFIX={prefix}",
        f"-DPython3_EXECUTABLE={prefix}/bin/python", "-DBUILD_TESTING=OFF", "-DPYTHON_ONLY=ON",
        "-DCMAKE_BUILD_TYPE=Release", f"-DCMAKE_C_FLAGS_RELEASE={flags}",
        f"-DCMAKE_CXX_FLAGS_RELEASE={flags}",
        "-DCMAKE_SHARED_LINKER_FLAGS=-Wl,--build-id=none",
        "-DCMAKE_MODULE_LINKER_FLAGS=-Wl,--build-id=none",
    )  # fmt: skip


def cmake(prefix: Path, *arguments: str) -> list[str]:
    """Command of the CMake of an environment."""
    return [f"{prefix}/bin/python", "-m", "cmake", *arguments]


def run(*commands: list[str]) -> int:
    """Run commands side by side; the exit code is 0, or that of one that failed."""
    prefix = Path(commands[0][0]).parents[1]
    dropped = ("PYTHONPATH", "LD_LIBRARY_PATH", "_ROS_WHEELS_BOOTSTRAP_COMPLETE")
    env = {name: value for name, value in os.environ.items() if name not in dropped}
    env |= {"AMENT_PREFIX_PATH": str(prefix), "CMAKE_PREFIX_PATH": str(prefix)}
    running = [subprocess.Popen(command, env=env) for command in commands]
    return max(abs(process.wait()) for process in running)


def pack(pythons: list[str], shipped: Path = SHIPPED) -> None:
    """Build the messages with several interpreters, each in a new environment, and ship them.

    Args:
        pythons: Commands of the interpreters.
        shipped: The archive to make.
    """
    builds: dict[str, dict[str, bytes]] = {}
    with tempfile.TemporaryDirectory() as folder:
        for number, python in enumerate(pythons):
            prefix = Path(folder, str(number))
            subprocess.run([python, "-m", "venv", str(prefix)], check=True)
            inside = str(prefix / "bin/python")
            for lock in ("lock.txt", "build.txt"):
                names = [str(ROOT / "requirements" / name) for name in ("install.py", lock)]
                subprocess.run([inside, *names], check=True)
            subprocess.run([inside, __file__, "build"], check=True)
            ask = [inside, "-c", "import sysconfig; print(sysconfig.get_config_var('SOABI'))"]
            name = subprocess.run(ask, check=True, capture_output=True, text=True).stdout.strip()
            builds[name] = contents(prefix)
    write(builds, shipped)


def contents(prefix: Path) -> dict[str, bytes]:
    """Files of the messages in an environment that are shipped, by name."""
    found = {}
    for path in sorted(prefix.rglob("*")):
        name = re.sub(r"^lib/python3\.\d+/site-", "site-", path.relative_to(prefix).as_posix())
        ours = any(package in name for package in PACKAGES)
        if ours and path.is_file() and KEPT.fullmatch(name):
            found[name] = path.read_bytes()
    return found


def write(builds: dict[str, dict[str, bytes]], shipped: Path) -> None:
    """Write an archive in which no file stands twice that is the same in all builds.

    Args:
        builds: Content of each file by name, by the binary interface it was built for.
        shipped: The archive.
    """
    members = {"key": key().encode()}
    for interface, files in builds.items():
        for name, content in files.items():
            same = all(other.get(name) == content for other in builds.values())
            members[f"{'all' if same and len(builds) > 1 else interface}/{name}"] = content
    with zipfile.ZipFile(shipped, "w") as archive:
        for name, content in sorted(members.items()):
            entry = zipfile.ZipInfo(name)  # its time is fixed: the same files are the same archive
            archive.writestr(entry, content, zipfile.ZIP_DEFLATED, 9)


def main() -> int:
    """Do what the first argument says."""
    what = sys.argv[1]
    prefix, site = Path(sys.prefix), Path(sysconfig.get_path("purelib"))
    if what == "check":
        if reason := check():
            sys.stdout.write(f"{reason}\n")
        return bool(reason)
    if what == "install":
        install(prefix, site)
        return 0
    if what == "build":
        return build(prefix, site)
    pack(sys.argv[2:])
    return 0


if __name__ == "__main__":
    sys.exit(main())
