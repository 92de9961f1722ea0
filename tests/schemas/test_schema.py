"""The emitted schemas accept real files, and refuse what readers refuse."""

import json
import tomllib
import zipfile
from pathlib import Path

import pytest
from scripts.make_schema import FOLDER, all_records, schema_of
from tests.schemas.validators import validator

jsonschema = pytest.importorskip("jsonschema", reason="jsonschema is not installed")

from vioapr.schemas.base import Document, encode  # noqa: E402
from vioapr.schemas.contract import Contract, parse  # noqa: E402

RECIPE_DATA = Path(__file__).parents[2] / "src" / "vioapr" / "recipes" / "data"
DOCUMENTS = [kind for kind in all_records() if issubclass(kind, Document)]


@pytest.mark.parametrize("path", sorted(FOLDER.glob("*.json")), ids=lambda path: path.name)
def test_every_schema_is_one_with_words(path):
    schema = json.loads(path.read_text())
    jsonschema.Draft202012Validator.check_schema(schema)
    assert schema["$id"] == path.name
    for part in (schema, *schema.get("$defs", {}).values()):
        if "enum" in part:
            continue
        assert part["title"]
        assert part["description"]


def test_members_have_the_words_of_their_record():
    schema = json.loads((FOLDER / "contract.schema.json").read_text())
    assert schema["properties"]["state_size"]["description"] == "Elements of the state."
    group = json.loads((FOLDER / "group-record.schema.json").read_text())
    words = group["$defs"]["SummaryRecord"]["properties"]["median_m"]["description"]
    assert words == "Median position error."


@pytest.mark.parametrize("kind", DOCUMENTS, ids=lambda kind: kind.__name__)
def test_documents_say_their_format_and_version(kind):
    schema = schema_of(kind, "x.schema.json")
    assert "version" in schema["required"]
    assert schema["properties"]["version"]["maximum"] == kind.VERSION
    if kind.FORMAT:
        assert schema["properties"]["format"] == {"const": kind.FORMAT}


@pytest.mark.parametrize(
    "path", sorted((FOLDER / "golden").glob("*.json")), ids=lambda path: path.stem
)
def test_golden_vectors(path):
    content = json.loads(path.read_text())
    validator("golden-vectors").validate(content)
    content["frames"][0]["outputs"]["world_from_cam"].append(0.0)
    with pytest.raises(jsonschema.ValidationError, match="is too long|expected at most"):
        validator("golden-vectors").validate(content)


@pytest.fixture(scope="module")
def shipped_contract():
    """The text in the localizer of the demo, which an earlier version exported."""
    ort = pytest.importorskip("onnxruntime", reason="onnxruntime is not installed")
    session = ort.InferenceSession(RECIPE_DATA / "localizer.onnx")
    return session.get_modelmeta().custom_metadata_map["vioapr"]


def test_the_contract_of_the_shipped_localizer(shipped_contract):
    content = json.loads(shipped_contract)
    validator("contract").validate(content)
    for name in ("part", "inputs", "version"):
        less = {key: value for key, value in content.items() if key != name}
        with pytest.raises(jsonschema.ValidationError, match=name):
            validator("contract").validate(less)


def test_a_contract_is_written_as_it_was(shipped_contract):
    contract = parse(shipped_contract, "localizer.onnx")
    assert contract.to_json() == shipped_contract
    assert isinstance(contract, Contract)
    assert json.loads(encode(contract)) == json.loads(shipped_contract)


def test_a_contract_without_the_newer_members_is_read():
    spec = {"name": "image", "dtype": "uint8", "shape": ["height", "width", 3], "meaning": ""}
    head = {"format": "vioapr localizer", "version": 1, "part": "apr"}
    contract = parse(json.dumps(head | {"inputs": [spec], "outputs": []}), "old.onnx")
    assert contract.inputs[0].shape == ("height", "width", 3)
    assert (contract.params, contract.method, contract.precision) == ((), None, "fp32")


@pytest.fixture(scope="module")
def demo_scene(tmp_path_factory):
    """The scene of the demo, as it is shipped."""
    folder = tmp_path_factory.mktemp("demo")
    with zipfile.ZipFile(RECIPE_DATA / "courtyard.zip") as archive:
        archive.extractall(folder)
    return folder / "courtyard"


def test_the_scene_of_the_demo(demo_scene):
    content = tomllib.loads((demo_scene / "scene.toml").read_text())
    validator("scene-document").validate(content)
    with pytest.raises(jsonschema.ValidationError, match="not of type"):
        validator("scene-document").validate(content | {"is_outdoor": "yes"})


def test_the_recording_of_the_demo(demo_scene):
    (path,) = demo_scene.glob("recordings/*/recording.json")
    content = json.loads(path.read_text())
    validator("recording-info").validate(content)
    with pytest.raises(jsonschema.ValidationError, match="is not one of"):
        validator("recording-info").validate(content | {"clock": "sundial"})
