# SPDX-License-Identifier: Apache-2.0
"""A file is its old content or its new one."""

import errno
import os
import resource
import shutil
import subprocess
import sys
import threading
import time
from pathlib import Path

import pytest

from loco_control.exceptions import ParameterError
from loco_control.files import check_writable, claim, locked, whole_folder, write_whole

DIES = """
import os, sys
from loco_control.files import write_whole
def half(file):
    file.write(b"new" * 100_000)
    file.flush()
    os._exit(9)
write_whole(sys.argv[1], half)
"""


@pytest.mark.parametrize(
    "content", ["é\n", "é\n".encode(), lambda file: file.write("é\n".encode())]
)
def test_text_bytes_and_writers_give_the_same_file_in_a_new_folder(tmp_path, content):
    path = tmp_path / "a" / "b" / "file.txt"
    assert write_whole(path, content) == path
    assert path.read_bytes() == b"\xc3\xa9\n"
    assert os.listdir(path.parent) == ["file.txt"]


@pytest.mark.parametrize("error", [OSError("disk full"), KeyboardInterrupt(), ValueError("no")])
def test_an_interrupted_writer_leaves_the_old_file_and_nothing_else(tmp_path, error):
    path = write_whole(tmp_path / "file", "old")

    def half(file):
        file.write(b"new")
        raise error

    with pytest.raises(type(error)):
        write_whole(path, half)
    assert path.read_text() == "old"
    assert os.listdir(tmp_path) == ["file"]


def test_a_killed_writer_leaves_the_old_file(tmp_path):
    path = write_whole(tmp_path / "file", "old")
    done = subprocess.run([sys.executable, "-c", DIES, str(path)], check=False, timeout=60)
    assert done.returncode == 9
    assert path.read_text() == "old"
    write_whole(path, "new")  # takes what the killed one left
    assert path.read_text() == "new"
    assert os.listdir(tmp_path) == ["file"]


def test_two_writers_of_a_file_wait_for_each_other(tmp_path):
    """Each writes in two pieces; the file is that of one of them, never a mixture."""
    path, began = tmp_path / "file", threading.Event()

    def slowly(file):
        file.write(b"first")
        file.flush()
        began.set()
        time.sleep(0.2)
        file.write(b"first")

    one = threading.Thread(target=write_whole, args=(path, slowly))
    one.start()
    assert began.wait(10.0)
    write_whole(path, "second")
    assert path.read_text() == "second"
    one.join()
    assert os.listdir(tmp_path) == ["file"]


def test_the_whole_content_is_on_the_disk_before_it_takes_the_name(tmp_path, monkeypatch):
    path, flushed = tmp_path / "file", []
    sync = os.fsync

    def watched(handle):
        sync(handle)
        flushed.append((os.fstat(handle).st_size, path.exists()))

    monkeypatch.setattr(os, "fsync", watched)
    write_whole(path, "content")
    assert flushed == [(7, False)]


def test_a_writer_whose_folder_is_gone_is_told_its_own_error(tmp_path):
    def lost(file):
        shutil.rmtree(tmp_path / "a")
        raise ValueError("no")

    with pytest.raises(ValueError, match="no"):
        write_whole(tmp_path / "a" / "file", lost)


def test_an_existing_file_is_replaced_and_readable_by_others(tmp_path):
    path = write_whole(tmp_path / "file", "a longer content than what follows")
    before = os.umask(0o022)
    try:
        write_whole(path, b"new")
    finally:
        os.umask(before)
    assert path.read_bytes() == b"new"
    assert path.stat().st_mode & 0o777 == 0o644


def test_a_folder_appears_whole_and_replaces_files_of_its_names(tmp_path):
    path = tmp_path / "a" / "b"
    with whole_folder(path) as work:
        (work / "one").write_text("1")
        assert not path.exists()
    with whole_folder(path) as work:
        (work / "two").write_text("2")
    assert sorted(os.listdir(path)) == ["one", "two"]
    assert os.listdir(path.parent) == ["b"]
    assert path.stat().st_mode & 0o777 == (tmp_path / "a").stat().st_mode & 0o777


def test_after_an_error_no_folder_is_left_not_even_above(tmp_path):
    def fail(path):
        with whole_folder(path) as work:
            (work / "one").write_text("1")
            raise ValueError("no")

    (tmp_path / "old").mkdir()
    for name in ("a/b/c", "old"):
        with pytest.raises(ValueError, match="no"):
            fail(tmp_path / name)
    assert [path.name for path in tmp_path.rglob("*")] == ["old"]


@pytest.fixture
def name():
    """Name of a lock that no other test run takes."""
    return f"test-lock-{os.getpid()}"


@pytest.mark.parametrize("longer", ["", "x" * 300])
def test_a_lock_is_had_once_and_holds_one_handle(name, longer):
    def handles():
        return len(os.listdir("/proc/self/fd"))

    name, before = name + longer, handles()
    with locked(name):
        for _ in range(3):
            with pytest.raises(BlockingIOError, match="in use"), locked(name):
                pass
        with locked(f"{name}-two"):
            assert handles() == before + 2
    assert handles() == before
    with locked(name):
        pass


def other(name, change=""):
    """Exit code of a process that takes a lock: 9 if it has it."""
    code = f"import os; from loco_control.files import locked\n{change}\n"
    code += f"try:\n  with locked('{name}'): os._exit(9)\nexcept BlockingIOError: os._exit(1)"
    return subprocess.run([sys.executable, "-c", code]).returncode


def test_a_lock_of_a_killed_process_is_free(name):
    assert other(name) == 9
    with locked(name):
        assert other(name) == 1
    assert other(name) == 9


@pytest.mark.skipif(os.geteuid() != 0, reason="only root can be somebody else")
def test_a_lock_holds_for_all_users(name):
    with locked(name):
        assert other(name, "os.setuid(65534)") == 1
    assert other(name, "os.setuid(65534)") == 9


def test_a_folder_that_can_be_written_is_left_as_it_is(tmp_path):
    check_writable(tmp_path / "a" / "b")
    check_writable(tmp_path)
    assert os.listdir(tmp_path) == []


@pytest.mark.parametrize("name", ["file/below", "\0", "x" * 300 + "/y", "/proc/none"])
def test_a_folder_that_cannot_be_written_is_refused_in_one_line(tmp_path, name):
    (tmp_path / "file").write_text("")
    with pytest.raises(ParameterError, match="nothing can be written.*--out") as caught:
        check_writable(tmp_path / name)
    assert "\n" not in str(caught.value) and "Errno" not in str(caught.value)
    assert f" in {str(tmp_path / name)[:100]!r}"[:-1] in str(caught.value)
    assert ("null byte" in str(caught.value)) == (name == "\0")


def test_a_disk_that_takes_no_byte_is_refused(tmp_path):
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (0, hard))
    try:
        with pytest.raises(ParameterError, match=os.strerror(errno.EFBIG)):
            check_writable(tmp_path)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


def test_a_folder_of_other_files_is_not_claimed(tmp_path):
    (tmp_path / "a").write_text("b")
    with pytest.raises(ParameterError, match="is a file"):
        claim(tmp_path / "a", "job.json")
    with pytest.raises(ParameterError, match="holds other files"):
        claim(tmp_path, "job.json")
    with pytest.raises(ParameterError, match="nothing can be written"):
        claim(Path("/proc/none"), "job.json")
    claim(tmp_path / "new", "job.json")
    assert not (tmp_path / "new").exists()
    (tmp_path / "job.json").write_text("{}")
    claim(tmp_path, "job.json")  # results of before
