# SPDX-License-Identifier: Apache-2.0
"""Whatever is wrong with a text or file of others is one error of ours, and costs little."""

import copy
import gzip
import io
import json
import subprocess
import sys
import time
import zipfile
from pathlib import Path

import numpy as np
import pytest

from loco_control import packed, reading
from loco_control.exceptions import LocoError, MissingFileError, ParameterError

LAUGHS = "a: &a [x, x, x, x, x, x, x, x, x]\n" + "".join(
    f"{b}: &{b} [{', '.join([f'*{a}'] * 9)}]\n" for a, b in zip("abcdefgh", "bcdefghi", strict=True)
)
BROKEN_YAML = {
    "open bracket": "a: [",
    "tab": "a:\n\t- b",
    "date of no day": "a: 2001-99-99",
    "whole number of 5000 digits": "a: " + "9" * 5000,
    "tag of no float": "a: !!float x",
    "tag of no int": "a: !!int ''",
    "tag of no bool": "a: !!bool x",
    "tag of no date": "a: !!timestamp x",
    "tag of Python": "a: !!python/object/apply:os.system [ls]",
    "key that is a list": "? [a]\n: b",
    "key that is a mapping": "? {a: b}\n: c",
    "NUL": "a: \0",
    "lone surrogate": "a: \udcff",
    "deep": "[" * 100_000,
    "deep and closed": "[" * 5000 + "]" * 5000,
    "deep mapping": "a: " + "{a: " * 200 + "}" * 200,
    "an alias to itself": "&a [*a]",
    "aliases that expand to 9 to the power of 9": LAUGHS,
    "unknown alias": "a: *b",
    "twice": "a: 1\na: 2",
    "two documents": "a: 1\n---\na: 2",
    "merge of a number": "<<: 3",
}


@pytest.mark.parametrize("how", BROKEN_YAML)
def test_what_is_wrong_with_a_yaml_text_is_one_line_of_ours_at_once(how):
    begin = time.process_time()
    with pytest.raises(ParameterError, match=r"model\.yaml") as caught:
        reading.parse_yaml(BROKEN_YAML[how], "model.yaml")
    assert time.process_time() - begin < 5.0  # aliases that expand would take for ever
    assert "\n" not in str(caught.value) and len(str(caught.value)) < 400


def test_the_line_of_a_mistake_is_told():
    with pytest.raises(ParameterError, match=r"^x.yaml, line 3, is not YAML: 'no' is no float"):
        reading.parse_yaml("a: 1\nb: 2\nc: !!float no\n", "x.yaml")


def test_yaml_that_is_right_is_read_with_numbers_as_people_write_them():
    text = "base: &b {k: 1e-3, n: [1, 2.5, yes]}\nother: {<<: *b, k: -2E4}\nempty:\n"
    assert reading.parse_yaml(text, "x") == {
        "base": {"k": 1e-3, "n": [1, 2.5, True]},
        "other": {"k": -2e4, "n": [1, 2.5, True]},
        "empty": None,
    }


def test_a_text_that_is_too_long_is_not_read():
    with pytest.raises(ParameterError, match="101 characters, at most 100"):
        reading.parse_yaml("a" * 101, "x", max_size=100)
    assert reading.parse_yaml("a" * 100, "x", max_size=100) == "a" * 100


@pytest.mark.parametrize("text", ["{", "[" * 100_000, "9" * 5000 + "", '{"a": }', "", "nul"])
def test_what_is_wrong_with_a_json_text_is_one_line_of_ours(text):
    with pytest.raises(ParameterError, match="log.json.*is not JSON"):
        reading.parse_json(text, "log.json")


def test_a_field_of_a_table_that_is_too_long_is_told_with_its_line():
    with pytest.raises(ParameterError, match="t.csv, line 2: field larger"):
        reading.parse_csv(["a,b", "1," + "9" * 200_000], "t.csv")


def test_files_that_are_none(tmp_path):
    (tmp_path / "latin").write_bytes(b"a: b\nc: caf\xe9\n")
    with pytest.raises(
        ParameterError, match="latin, line 2: not UTF-8 text, byte 0xe9 .*iconv -f latin1"
    ):
        reading.read_yaml(tmp_path / "latin")
    with pytest.raises(ParameterError, match="blank, line 2: not"):
        reading.as_text(b"\n\xe9", "blank")
    for path in (tmp_path / "none", tmp_path, "a\0b", "x" * 5000, "/dev/zero"):
        with pytest.raises(MissingFileError):
            reading.read_text(path)


def test_a_compressed_file_is_read_up_to_a_limit(tmp_path):
    path = tmp_path / "t.csv.gz"
    path.write_bytes(gzip.compress(b"a,b\n1,2\n"))
    assert reading.read_text(path) == "a,b\n1,2\n"
    path.write_bytes(gzip.compress(bytes(2**20)))
    with pytest.raises(ParameterError, match="larger than 0.5 MiB decompressed"):
        reading.read_text(path, max_size=2**19)
    whole = path.read_bytes()
    for broken in (whole[:20], whole[:-4], whole[:30] + b"\xff" * 9 + whole[39:], b"no gzip"):
        path.write_bytes(broken)
        with pytest.raises(ParameterError, match="not a gzip file"):
            reading.read_text(path)


def archive(**arrays):
    stream = io.BytesIO()
    np.savez_compressed(stream, **arrays)
    return stream.getvalue()


def test_every_truncation_and_many_flips_of_an_archive_are_errors_of_ours(tmp_path):
    path, rng = tmp_path / "w.npz", np.random.default_rng(0)
    whole = archive(a=np.arange(9.0), meta=json.dumps({"kind": "weights"}))
    path.write_bytes(whole)
    assert reading.read_npz(path)["a"].tolist() == list(range(9))
    for size in range(len(whole)):
        path.write_bytes(whole[:size])
        with pytest.raises(LocoError):
            reading.read_npz(path)
    refused = 0
    for _ in range(1000):
        data = bytearray(whole)
        data[rng.integers(len(data))] ^= 1 << rng.integers(8)
        path.write_bytes(data)
        try:
            reading.read_npz(path)
        except LocoError:
            refused += 1
    assert refused > 500


def test_an_archive_that_expands_too_far_or_holds_pickles_is_refused(tmp_path):
    path = tmp_path / "w.npz"
    path.write_bytes(archive(a=np.zeros(packed.FREE // 8 - 100)))
    assert len(reading.read_npz(path)["a"]) == packed.FREE // 8 - 100
    path.write_bytes(archive(a=np.zeros(packed.FREE // 8)))
    with pytest.raises(ParameterError, match="at most 67108864 are unpacked of"):
        reading.read_npz(path)
    stream = io.BytesIO()
    np.savez(stream, a=np.array([{"x": 1}], dtype=object))
    path.write_bytes(stream.getvalue())
    with pytest.raises(ParameterError, match="not a file"):
        reading.read_npz(path)
    with zipfile.ZipFile(path, "w") as z:  # a header that promises more than there is
        z.writestr("a.npy", npy("<f8", "(999999999999,)"))
    with pytest.raises(ParameterError, match="of shape .* has 0 bytes"):
        reading.read_npz(path)


def npy(kind, shape):
    header = f"{{'descr': '{kind}', 'fortran_order': False, 'shape': {shape}, }}"
    return b"\x93NUMPY\x01\x00v\x00" + header.encode().ljust(117) + b"\n"


@pytest.mark.parametrize("kind", ["<U0", "|V0", "|O", "<M8[s]"])
def test_arrays_of_other_things_than_numbers_and_texts_are_refused(tmp_path, kind):
    with zipfile.ZipFile(tmp_path / "w.npz", "w") as z:  # no bytes need any shape of nothings
        z.writestr("a.npy", npy(kind, f"({2**40},)"))
    with pytest.raises(ParameterError, match="read are numbers and texts"):
        reading.read_npz(tmp_path / "w.npz")


def test_a_packed_text_fills_no_more_than_its_size_allows(tmp_path):
    path = tmp_path / "t.csv.gz"
    path.write_bytes(gzip.compress(bytes(packed.FREE)))
    assert len(reading.read_bytes(path)) == packed.FREE
    path.write_bytes(gzip.compress(bytes(packed.FREE + 1)))
    with pytest.raises(ParameterError, match="larger than 64 MiB decompressed"):
        reading.read_bytes(path)


@pytest.mark.parametrize("how", [zipfile.ZIP_BZIP2, zipfile.ZIP_LZMA])
def test_a_zip_of_other_methods_is_refused(tmp_path, how):
    with zipfile.ZipFile(tmp_path / "w.npz", "w", how) as z:  # LZMA asks for gigabytes
        z.writestr("a.npy", npy("<f8", "(0,)"))
    with pytest.raises(ParameterError, match="another method than deflation"):
        reading.read_npz(tmp_path / "w.npz")


def test_files_in_a_zip_that_share_their_bytes_are_counted_each(tmp_path):
    """A megabyte of zeros in a kilobyte, named a thousand times: no quadratic work."""
    with zipfile.ZipFile(tmp_path / "w.npz", "w", zipfile.ZIP_DEFLATED) as z:
        z.writestr("a.npy", bytes(2**20))
        for k in range(1000):
            entry = copy.copy(z.infolist()[0])
            entry.filename = f"b{k}.npy"
            z.filelist.append(entry)
    with pytest.raises(ParameterError, match="unpacked it has 10496"):
        reading.read_npz(tmp_path / "w.npz")


@pytest.mark.parametrize("name", ["", ".", "..", "../x", "a/b", "a\\b", "a\0b", "a\nb", "x" * 201])
def test_a_name_never_leaves_its_folder(tmp_path, name):
    with pytest.raises(ParameterError, match="must be a plain file name"):
        reading.within(tmp_path, name)


def test_a_plain_name_is_a_file_of_its_folder(tmp_path):
    for right in ("gehölz 1.yaml", "x" * 200):
        assert reading.within(tmp_path, right) == tmp_path / right


def test_the_limits_are_those_of_the_page():
    page = (Path(__file__).parents[2] / "docs" / "reliability.md").read_text()
    assert f"| {reading.MOST_YAML / 2**20:g} MiB, {reading.DEEPEST} levels, " in page
    assert f"levels, {reading.MOST_NODES:,} values" in page
    assert f"| {reading.MOST_BYTES / 2**30:g} GiB, also after decompression" in page


def test_numpy_is_loaded_by_those_who_read_arrays():
    code = "import sys, loco_control.reading; sys.exit('numpy' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def test_a_value_is_shown_whole_or_cut_to_the_length_with_a_sign():
    assert reading.shown("x" * 58) == repr("x" * 58)
    assert reading.shown("x" * 59) == "'" + "x" * 58 + "…"
    assert reading.shown([1, 2], max_length=6) == "[1, 2]"
    assert reading.shown([1, 2], max_length=5) == "[1, …"


@pytest.mark.parametrize("packed", [False, True])
def test_a_file_at_the_limit_is_read_whole_and_a_byte_more_is_refused(tmp_path, packed):
    path, pack = (tmp_path / "a.gz", gzip.compress) if packed else (tmp_path / "a", bytes)
    path.write_bytes(pack(b"x" * 4096))
    assert reading.read_bytes(path, max_size=4096) == b"x" * 4096
    with pytest.raises(ParameterError, match="which is the limit"):
        reading.read_bytes(path, max_size=4095)


def test_a_loader_that_stumbles_names_its_source_cut_to_200_characters():
    @reading.understood("gait")
    def load(source):
        return source["no index"]

    with pytest.raises(ParameterError) as caught:
        load("x" * 300)
    assert str(caught.value).startswith("'" + "x" * 198 + "… is not a gait: ")


def test_levels_are_counted_from_the_top_whatever_stands_beside_them():
    most, beside = reading.DEEPEST, "a, " * 100
    assert reading.parse_yaml("[" * most + "]" * most, "x")
    for before in ("", beside):
        text = f"[{before}" + "[" * most + "]" * most + "]"
        with pytest.raises(ParameterError, match=f"more than {most} levels deep$"):
            reading.parse_yaml(text, "x")
    wide = f"[{beside}" + "[" * (most - 1) + "]" * (most - 1) + "]"
    assert len(reading.parse_yaml(wide, "x")) == 101


def test_a_peer_may_name_files_below_the_folders_and_no_others(tmp_path):
    bags, other = tmp_path / "bags", tmp_path / "other"
    bags.mkdir()
    other.mkdir()
    (bags / "link").symlink_to(other)
    assert reading.allowed(bags / "a" / ".." / "b", [other, bags]) == bags / "b"
    for path in (other, bags / ".." / "other", bags / "link" / "x", "a\0b"):
        with pytest.raises(ParameterError, match=f"is not below {bags}; the parameter folders"):
            reading.allowed(path, [bags])
    with pytest.raises(ParameterError, match="is not below any folder; "):
        reading.allowed(bags, [])
    with pytest.raises(ParameterError, match="is not below"):
        reading.allowed(bags, [""])  # which is not the folder that we are in


def test_levels_and_values_behind_aliases_count(monkeypatch):
    text = "- &a [[[x]]]\n- [*a]\n"  # 6 levels; 1 + 4 + 5 values
    monkeypatch.setattr(reading, "DEEPEST", 6)
    monkeypatch.setattr(reading, "MOST_NODES", 10)
    assert reading.parse_yaml(text, "x") == [[[["x"]]], [[[["x"]]]]]
    assert reading.parse_yaml("[&a [x, x], *a, x, x, x]", "x")[1:3] == [["x", "x"], "x"]
    with pytest.raises(ParameterError, match="more than 10 values"):
        reading.parse_yaml("[&a [x, x], *a, x, x, x, x]", "x")
    with pytest.raises(ParameterError, match="nested more than 6 levels deep with its aliases"):
        reading.parse_yaml("&a [*a]", "x")
    monkeypatch.setattr(reading, "DEEPEST", 5)
    with pytest.raises(ParameterError, match="5 levels"):
        reading.parse_yaml(text, "x")


def test_a_mapping_may_be_merged_from_two():
    text = "a: &a {x: 1}\nb: &b {y: 2}\nc: {<<: *a, <<: *b}\n"
    assert reading.parse_yaml(text, "x")["c"] == {"x": 1, "y": 2}


@pytest.mark.parametrize("encoding", ["utf-16", "utf-16-le", "utf-16-be"])
def test_utf_16_is_read_by_its_mark(encoding):
    mark = "" if encoding == "utf-16" else "\ufeff"
    assert reading.as_text((mark + "a: °\n").encode(encoding), "wide") == "a: °\n"
