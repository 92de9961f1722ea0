"""Whatever bytes a file holds, a reader reads it or raises one of our errors."""

import json
import zlib

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from tests.formats.conftest import FOLDERS, file_name, make_trajectory
from tests.formats.samples import write_sample

from vioapr.errors import VioAprError
from vioapr.formats.base import ReadOptions
from vioapr.formats.inspection import inspect_file
from vioapr.formats.registry import FORMATS, rank_formats
from vioapr.schemas.base import to_plain

pytestmark = pytest.mark.slow

ALL = pytest.mark.parametrize("format_", FORMATS.values(), ids=FORMATS)
OPTIONS = st.builds(
    ReadOptions,
    rate_hz=st.sampled_from([None, 1e-9, 2.0]),
    sequence=st.sampled_from([None, None, "seq-01"]),
    time_unit=st.sampled_from([None, None, "s", "ms", "us", "ns"]),
    strict=st.booleans(),
)
FUZZ = settings(
    deadline=None,
    max_examples=60,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)
SPLICES = st.lists(
    st.tuples(
        st.floats(0, 1, exclude_max=True),
        st.integers(0, 8),
        st.sampled_from(
            [b"", b"\0", b"\xff", b"nan", b"1e999", b"-", b" ", b"\n", b",", b"9" * 5000, b"1e308"]
        )
        | st.binary(max_size=6),
    ),
    min_size=1,
    max_size=4,
)
TOKENS = st.sampled_from(["0", "1", "-1e308", "nan", "inf", "a.png", "#", "1e-320", "9" * 400])
TABLES = st.lists(st.lists(TOKENS, max_size=16), max_size=6).flatmap(
    lambda rows: st.sampled_from([" ", ","]).map(
        lambda separator: "\n".join(separator.join(row) for row in rows).encode()
    )
)


def read_or_refuse(format_, path, options):
    try:
        for candidate, confidence in rank_formats(path):
            assert 0 <= confidence <= 1, candidate.name
        format_.read(path, options)
    except VioAprError:
        return
    json.dumps(to_plain(inspect_file(path, format_.name, options)), allow_nan=False)


FIRST_FILES = {
    "7scenes": "frame-000000.pose.txt",
    "scannet": "0.txt",
    "polycam": "keyframes/cameras/1700000000000000.json",
    "3dscannerapp": "frame_00000.json",
}


def place(format_, folder, content):
    """Put content where the format reads it."""
    path = folder / file_name(format_)
    file = path
    if format_.name in FOLDERS:
        file = path / FIRST_FILES[format_.name]
        file.parent.mkdir(parents=True, exist_ok=True)
    file.write_bytes(content)
    return path


@ALL
@FUZZ
@given(st.binary(max_size=300) | st.text(max_size=200).map(str.encode) | TABLES, OPTIONS)
def test_random_content(format_, tmp_path, content, options):
    read_or_refuse(format_, place(format_, tmp_path, content), options)


@ALL
@FUZZ
@given(SPLICES, OPTIONS, st.booleans())
def test_mutated_files(format_, tmp_path, splices, options, is_zip):
    content = bytearray(valid_content(format_, tmp_path, is_zip=is_zip))
    for where, length, replacement in splices:
        at = int(where * len(content))
        content[at : at + length] = replacement
    read_or_refuse(format_, place(format_, tmp_path, bytes(content)), options)


@ALL
@FUZZ
@given(st.floats(0, 1), st.floats(0, 1), st.integers(0, 255))
def test_broken_gzip(format_, tmp_path, keep, where, value):
    packer = zlib.compressobj(wbits=31)
    packed = bytearray(packer.compress(valid_content(format_, tmp_path)) + packer.flush())
    packed[int(where * (len(packed) - 1))] = value
    content = bytes(packed[: int(keep * len(packed))])
    read_or_refuse(format_, place(format_, tmp_path, content), ReadOptions())


CACHE = {}


def valid_content(format_, folder, *, is_zip=False):
    key = format_.name, is_zip and format_.name == "record3d"
    if key not in CACHE:
        source = folder / "valid"
        source.mkdir(exist_ok=True)
        path = source / ("walk.r3d" if key[1] else file_name(format_))
        write_sample(format_, path, make_trajectory(format_, 4))
        file = path if path.is_file() else min(path.rglob("*[0-9].*"))
        CACHE[key] = file.read_bytes()
    return CACHE[key]
