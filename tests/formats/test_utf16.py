"""Text in UTF-16, as Excel and PowerShell write it, is read; without its mark it is refused."""

import gzip

import pytest

from vioapr.errors import FormatError
from vioapr.formats.registry import rank_formats, read_trajectory, read_with_notes

POSES = "timestamp,x,y,z,qx,qy,qz,qw\r\n" + "".join(
    f"{k / 10},{k},2,3,0,0,0,1\r\n" for k in range(3000)
)


@pytest.mark.parametrize("encoding", ["utf-8-sig", "utf-16", "utf-16-le", "utf-16-be"])
@pytest.mark.parametrize("is_gzip", [False, True])
def test_text_with_a_mark_is_read(encoding, is_gzip, tmp_path):
    content = POSES.encode(encoding)
    if encoding.endswith("le"):
        content = b"\xff\xfe" + content
    elif encoding.endswith("be"):
        content = b"\xfe\xff" + content
    path = tmp_path / "log.csv"
    path.write_bytes(gzip.compress(content) if is_gzip else content)
    reading = read_with_notes(path)
    assert (reading.format.name, len(reading.trajectory)) == ("table", 3000)
    assert reading.trajectory.position_m[7].tolist() == [7, 2, 3]


@pytest.mark.parametrize("encoding", ["utf-16-le", "utf-16-be"])
def test_text_without_a_mark_is_refused_by_its_name(encoding, tmp_path):
    path = tmp_path / "log.csv"
    path.write_bytes(POSES.encode(encoding))
    with pytest.raises(FormatError, match="UTF-16 without a mark: save it as UTF-8"):
        read_trajectory(path)
    with pytest.raises(FormatError, match="got UTF-16 without a mark: save as UTF-8"):
        read_trajectory(path, "tum")


def test_binary_content_that_begins_as_a_mark_is_no_text(tmp_path):
    path = tmp_path / "images.bin"
    path.write_bytes(b"\xff\xfe\x00\x00" + bytes(100))
    assert rank_formats(path) == []
