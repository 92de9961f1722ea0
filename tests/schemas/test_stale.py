"""What stands in schema/ is what its scripts make."""

from scripts import make_golden


def test_golden_vectors_are_what_numpy_answers():
    made = make_golden.make_texts()
    assert set(made) == {path.name for path in make_golden.FOLDER.iterdir()}
    for name, text in made.items():
        assert (make_golden.FOLDER / name).read_text(encoding="utf-8") == text, name
