"""Metadata of ONNX files, read without ONNX."""

import random

import pytest

from vioapr.errors import FileMissingError, FormatError
from vioapr.files.onnx_metadata import read_onnx_metadata
from vioapr.recipes.demo import unpack_demo


def test_as_onnxruntime_reads_it(tmp_path):
    onnxruntime = pytest.importorskip("onnxruntime", reason="onnxruntime is not installed")
    model = unpack_demo(tmp_path).model
    session = onnxruntime.InferenceSession(model, providers=["CPUExecutionProvider"])
    assert read_onnx_metadata(model) == session.get_modelmeta().custom_metadata_map


def test_by_hand(tmp_path):
    path = tmp_path / "x.onnx"
    graph = b"\x3a\x80\x01" + bytes(128)  # field 7, of 128 bytes
    numbers = b"\x08\x0a" + b"\x11" + bytes(8) + b"\x15" + bytes(4)
    path.write_bytes(numbers + graph + b"\x72\x07\x0a\x01k\x12\x02vv")
    assert read_onnx_metadata(path) == {"k": "vv"}


@pytest.mark.parametrize(
    "content",
    [b"PK\x03\x04 a zip", b"\x3a\xff\xff\xff\x7f", b"\x72\x07\x0a\x01k", b"\x72\x02\x0a\x05",
     b"\xff" * 20, b"\x72\x04\x0a\x02\xff\xfe\x12"],
)  # fmt: skip
def test_other_files_are_refused(tmp_path, content):
    path = tmp_path / "x.onnx"
    path.write_bytes(content)
    with pytest.raises(FormatError, match="expected an ONNX file"):
        read_onnx_metadata(path)


def test_noise_is_refused_or_has_nothing(tmp_path):
    path = tmp_path / "x.onnx"
    with pytest.raises(FileMissingError):
        read_onnx_metadata(path)
    noise = random.Random(1)
    for _ in range(300):
        path.write_bytes(noise.randbytes(noise.randrange(60)))
        try:
            read_onnx_metadata(path)
        except FormatError as error:
            assert "expected an ONNX file" in str(error)  # noqa: PT017
