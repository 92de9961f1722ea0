"""Validators by the emitted schemas, for tests of what rooms write."""

import json
from pathlib import Path

import pytest

FOLDER = Path(__file__).parents[2] / "schema"


def validator(name):
    """What `schema/NAME.schema.json` accepts; `validate` raises a `ValidationError`."""
    jsonschema = pytest.importorskip("jsonschema", reason="jsonschema is not installed")
    schema = json.loads((FOLDER / f"{name}.schema.json").read_text())
    return jsonschema.Draft202012Validator(schema)
