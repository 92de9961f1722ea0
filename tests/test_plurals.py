import pytest

from vioapr.plurals import agree, count_of


@pytest.mark.parametrize(
    ("count", "text"), [(0, "0 frames"), (1, "1 frame"), (2, "2 frames"), (1000, "1000 frames")]
)
def test_counts(count, text):
    assert count_of(count, "frame") == text


def test_other_plurals_and_verbs():
    assert count_of(1, "matrix", "matrices") == "1 matrix"
    assert count_of(3, "matrix", "matrices") == "3 matrices"
    assert [agree(n, "has", "have") for n in (0, 1, 2)] == ["have", "has", "have"]
