"""An error about a file of no format says which is nearest, and why it is not that."""

import pytest

from vioapr.errors import FormatError
from vioapr.formats.registry import read_trajectory

POSE = "1 2 3 0 0 0 1"


@pytest.mark.parametrize(
    ("name", "content", "pattern"),
    [
        ("a.csv", "t,x,y,z\n1,2,3,4\n", "is table, but its header does not name .*: t, x, y, z;"),
        ("a.csv", "lat,lon,alt\n1,2,3\n", r"degrees on the globe \(lat, lon, alt\): convert"),
        ("a.txt", "1 2 3 4 5 6 7\n" * 3, "is tum, but its rows have 7 columns where 8 .* belong"),
        ("a.txt", "1 2 3 4 5 6 7 8 9\n" * 3, "tum, but columns 5 to 8 .* no unit quaternion"),
        ("a.txt", " ".join("1" * 14) + "\n", "is kitti, but its rows of 14 columns hold neither"),
        ("a.txt", f"0 {POSE}\n1 {POSE[:-2]}\n2 {POSE}\n", "a.txt:2: expected 8 .* nearest .* tum"),
        ("a.txt", f"0 {POSE}\nb {POSE}\n2 {POSE}\n", "a.txt:2: expected a number, got 'b'"),
        ("a.txt", "Dear Sir,\nno poses\n", "a.txt: expected a trajectory, got text of no known"),
        ("a.tum", "1 2 3\n", r"a.tum:1: expected 8 columns .*got 3 .*nearest format is tum"),
        ("a.tum", "Dear Sir,\nno poses\n", "a.tum.* expected .*nearest format is tum"),
        ("a.json", '{"a": 1}', "a.json: .* nearest format is nerfstudio"),
    ],
)
def test_what_cannot_be_read_names_the_nearest_format(name, content, pattern, tmp_path):
    path = tmp_path / name
    path.write_text(content)
    with pytest.raises(FormatError, match=pattern) as caught:
        read_trajectory(path)
    assert "\n" not in str(caught.value)
