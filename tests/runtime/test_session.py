"""The class of an error says what is wrong with a file."""

from pathlib import Path

import msgspec
import pytest

from vioapr.errors import (
    ContractError,
    FileMissingError,
    FormatError,
    UnreadableError,
    VersionError,
)
from vioapr.schemas.contract import METADATA_KEY

pytest.importorskip("onnxruntime", reason="onnxruntime is not installed")

from vioapr.runtime.session import open_session, require_localizer

SHIPPED = Path(__file__).parents[2] / "src" / "vioapr" / "recipes" / "data" / "localizer.onnx"


def test_the_shipped_localizer_is_one():
    session, contract = open_session(SHIPPED, threads=1)
    require_localizer(contract, SHIPPED)
    assert (contract.part, contract.method) == ("localizer", "chain")
    assert [value.name for value in session.get_outputs()] == list(contract.output_names)
    assert contract.regressor.scenes == ("Simulated courtyard",)


def test_files_that_are_no_model(tmp_path):
    with pytest.raises(FileMissingError, match="none of this name"):
        open_session(tmp_path / "none.onnx")
    with pytest.raises(UnreadableError, match="cannot be read"):
        open_session(tmp_path)
    text = tmp_path / "text.onnx"
    text.write_text("not a model")
    with pytest.raises(FormatError, match="truncated, damaged or something else") as caught:
        open_session(text)
    assert caught.value.path == str(text)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("old", "new", "error", "message"),
    [
        ('"version": 2', '"version": 99', VersionError, "its contract: expected version 2, got 99"),
        ('"part": "localizer"', '"part": 3', FormatError, "its contract: part: "),
        (
            '"name": "timestamp_s"',
            '"name": "time"',
            ContractError,
            "expected the contract's inputs",
        ),
    ],
)
def test_contracts_that_are_not_kept(tmp_path, old, new, error, message):
    onnx = pytest.importorskip("onnx", reason="onnx is not installed")
    model = onnx.load(SHIPPED)
    (entry,) = (entry for entry in model.metadata_props if entry.key == METADATA_KEY)
    assert old in entry.value
    entry.value = entry.value.replace(old, new)
    path = tmp_path / "changed.onnx"
    onnx.save(model, path)
    with pytest.raises(error, match=message):
        open_session(path, threads=1)


def test_a_part_is_no_localizer():
    _, contract = open_session(SHIPPED, threads=1)
    part = msgspec.structs.replace(contract, part="apr")
    with pytest.raises(ContractError, match="export without --split"):
        require_localizer(part, SHIPPED)
