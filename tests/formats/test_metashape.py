"""Metashape's XML: the chunk's transform with scale, components, cameras that are not aligned."""

import numpy as np
import pytest

from vioapr.errors import FormatError, ParameterError
from vioapr.formats.base import ReadOptions
from vioapr.formats.notes import ReadingNotes
from vioapr.formats.registry import rank_formats, read_trajectory

# A camera of the chunk at (1, 2, 3), looking along the chunk's z.
AT_123 = "1 0 0 1 0 1 0 2 0 0 1 3 0 0 0 1"
TRANSFORM = (
    "<transform><rotation>0 -1 0 1 0 0 0 0 1</rotation><translation>10 20 30</translation>"
    "<scale>2</scale></transform>"
)


def camera(label, matrix=AT_123, more=""):
    transform = f"<transform>{matrix}</transform>" if matrix else ""
    return f'<camera id="0" sensor_id="0" label="{label}"{more}>{transform}</camera>'


def write(path, cameras, chunk=TRANSFORM, before=""):
    path.write_text(
        f'<?xml version="1.0" encoding="UTF-8"?>\n<document version="2.0.0"><chunk label="c">'
        f"{before}<cameras next_id='9'>{cameras}</cameras>{chunk}</chunk></document>\n"
    )
    return path


def read(path, **options):
    notes = ReadingNotes()
    return read_trajectory(path, None, ReadOptions(notes=notes, **options)), notes


def test_the_chunks_transform_is_applied(tmp_path):
    """A quarter turn about z, twice as large: (1, 2, 3) becomes (-4, 2, 6), and is moved."""
    path = write(tmp_path / "cameras.xml", camera("b.jpg") + camera("a.jpg"))
    assert rank_formats(path)[0][0].name == "metashape"
    track, notes = read(path)
    assert track.names == ("a.jpg", "b.jpg")
    np.testing.assert_allclose(track.position_m[0], [6, 22, 36], atol=1e-12)
    right = track.target_from_source.to_matrix()[0, :3, 0]
    np.testing.assert_allclose(right, [0, 1, 0], atol=1e-12)
    assert not notes.warnings


def test_a_published_chunk(tmp_path):
    """The numbers of Agisoft's forum, topic 10793: a rotation without a scale."""
    numbers = (
        "2.6820370473203603e-001 1.3446275402548258e-001 -9.5393214672108295e-001 "
        "-2.1636560095239896e+000 2.2031328011198015e-001 -9.7253059016345711e-001 "
        "-7.5141931054625438e-002 6.4176770852101956e+000 -9.3783198461894612e-001 "
        "-1.9001057595881468e-001 -2.9046023763931694e-001 -1.5814986849312186e+001 0 0 0 1"
    )
    chunk = (
        '<transform><rotation locked="false">9.9806616004513493e-001 -1.1181879989736994e-002 '
        "6.1146592158959429e-002 4.7912979822793356e-002 7.6508013335616765e-001 "
        "-6.4215008830351294e-001 -3.9601597660442994e-002 6.4383798824207616e-001 "
        '7.6413634801593910e-001</rotation><translation locked="false">3.4907376798206847e+001 '
        "-1.2150597136175513e+001 3.0027245704839842e+000</translation></transform>"
    )
    track, notes = read(write(tmp_path / "cameras.xml", camera("Front", numbers), chunk))
    assert notes.warnings == ["the project has no scale: positions are not metres"]
    rotation = np.array(chunk.split(">")[2].split("<")[0].split(), dtype=float).reshape(3, 3)
    moved = rotation @ [-2.1636560095239896, 6.4176770852101956, -15.814986849312186]
    translation = [34.907376798206847, -12.150597136175513, 3.0027245704839842]
    np.testing.assert_allclose(track.position_m[0], moved + translation, atol=1e-9)
    np.testing.assert_allclose(track.position_m[0], [31.709111, 2.811368, -4.864453], atol=1e-6)


def test_components_have_their_own_transform(tmp_path):
    components = (
        "<components><component id='0'><transform><rotation>1 0 0 0 1 0 0 0 1</rotation>"
        "<translation>0 0 100</translation><scale>10</scale></transform></component></components>"
    )
    cameras = camera("a", more=' component_id="0"') + camera("b")
    track, _ = read(write(tmp_path / "cameras.xml", cameras, before=components))
    np.testing.assert_allclose(track.position_m, [[10, 20, 130], [6, 22, 36]], atol=1e-12)


def test_groups_and_cameras_that_are_not_aligned(tmp_path):
    cameras = f"<group id='0'>{camera('a')}{camera('b', '')}</group>{camera('c')}"
    track, notes = read(write(tmp_path / "cameras.xml", cameras))
    assert track.names == ("a", "c")
    assert [row.name for row in notes.left_out] == ["b"]


def test_georeferenced_projects_are_geocentric(tmp_path):
    chunk = TRANSFORM.replace("10 20 30", "4e6 1e6 4.8e6")
    _, notes = read(write(tmp_path / "cameras.xml", camera("a"), chunk))
    assert "geocentric" in notes.warnings[0]


def test_several_chunks_need_a_choice(tmp_path):
    path = write(tmp_path / "cameras.xml", camera("a"))
    text = path.read_text()
    chunk = text[text.index("<chunk") : text.index("</document>")]
    second = chunk.replace('label="c"', 'label="d"').replace('label="a"', 'label="e"')
    path.write_text(text.replace("</document>", f"{second}</document>"))
    with pytest.raises(ParameterError, match="several chunks: choose one with `sequence`: c, d"):
        read(path)
    with pytest.raises(ParameterError, match="several chunks"):
        read(path, sequence="x")


@pytest.mark.parametrize(
    ("content", "problem"),
    [
        ("<document><chunk", "expected XML: "),
        ("<document><chunk/></document>", "expected a chunk with cameras"),
        ("<document><chunk><cameras/></chunk></document>", "expected cameras in the chunk"),
        ('<!DOCTYPE x [<!ENTITY a "b">]><document><chunk/></document>', "without a document type"),
        ("<document/>", "expected a chunk with cameras"),
    ],
)
def test_malformed(content, problem, tmp_path):
    path = tmp_path / "cameras.xml"
    path.write_text(content)
    with pytest.raises(FormatError, match=problem):
        read_trajectory(path, "metashape")


@pytest.mark.parametrize("matrix", ["1 2 3", "x " * 16, AT_123 + " 5"])
def test_matrices_of_another_size(matrix, tmp_path):
    path = write(tmp_path / "cameras.xml", camera("a") + camera("b", matrix))
    with pytest.raises(FormatError, match=r":2: expected 16 numbers in a camera's transform"):
        read_trajectory(path, "metashape")


@pytest.mark.parametrize("scale", ["0", "-1", "nan", "inf"])
def test_scales_that_are_none(scale, tmp_path):
    chunk = TRANSFORM.replace("<scale>2", f"<scale>{scale}")
    path = write(tmp_path / "cameras.xml", camera("a"), chunk)
    with pytest.raises(FormatError, match="expected a scale above 0"):
        read_trajectory(path, "metashape")
