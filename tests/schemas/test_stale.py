"""What stands in schema/ is what its scripts make."""

import pytest
from scripts import make_golden, make_schema


@pytest.mark.slow
def test_golden_vectors_are_what_numpy_answers():
    made = make_golden.make_texts()
    assert set(made) == {path.name for path in make_golden.FOLDER.iterdir()}
    for name, text in made.items():
        assert (make_golden.FOLDER / name).read_text(encoding="utf-8") == text, name


def test_schemas_are_those_of_the_records():
    made = make_schema.make_texts()
    assert set(made) == {path.name for path in make_schema.FOLDER.glob("*.schema.json")}
    for name, text in made.items():
        found = (make_schema.FOLDER / name).read_text(encoding="utf-8")
        assert found == text, f"{name}: run python scripts/make_schema.py"
