import pytest

from vioapr.plurals import count_of


@pytest.mark.parametrize(
    ("count", "text"), [(0, "0 frames"), (1, "1 frame"), (2, "2 frames"), (1000, "1000 frames")]
)
def test_counts(count, text):
    assert count_of(count, "frame") == text


def test_other_plurals_and_verbs():
    assert count_of(1, "matrix", "matrices") == "1 matrix"
    assert count_of(3, "matrix", "matrices") == "3 matrices"
    assert count_of(1, "frame has", "frames have") == "1 frame has"
    assert count_of(2, "frame has", "frames have") == "2 frames have"
