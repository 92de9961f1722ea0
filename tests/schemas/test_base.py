"""What records promise to whoever reads or writes a file."""

import json
from typing import Annotated, ClassVar

import msgspec
import numpy as np
import pytest

from vioapr.errors import FormatError, VersionError
from vioapr.schemas.base import Document, Record, convert, decode, encode, to_plain


class Part(Record, frozen=True):
    size: Annotated[int, msgspec.Meta(ge=1)]
    names: tuple[str, ...] = ()


class Thing(Document, frozen=True, kw_only=True):
    FORMAT: ClassVar[str] = "a thing"
    VERSION: ClassVar[int] = 2

    weight_kg: float | None
    parts: tuple[Part, ...] = ()


HEAD = '{"format": "a thing", "version": 2'


def test_what_is_written_is_read():
    thing = Thing(weight_kg=1.5, parts=(Part(3, ("a", "ü")), Part(1)))
    text = encode(thing)
    assert list(json.loads(text)) == ["format", "version", "weight_kg", "parts"]
    assert text.endswith("}\n")
    assert "ü" in text
    assert decode("t.json", text, Thing) == thing


@pytest.mark.parametrize(
    ("members", "message"),
    [
        ('"weight_kg": "x"', "t.json: weight_kg: expected a number or nothing, got 'x'"),
        (
            '"weight_kg": 1, "parts": [{"size": 1}, {"size": 0}]',
            "t.json: parts[1].size: expected `int` >= 1",
        ),
        (
            '"weight_kg": 1, "parts": [{"size": 1.5}]',
            "t.json: parts[0].size: expected a whole number, got 1.5",
        ),
        ('"weight_kg": 1, "parts": [{}]', "t.json: parts[0]: expected a member 'size', found none"),
        ('"parts": []', "t.json: expected a member 'weight_kg', found none"),
        ('"weight_kg": 1, "parts": {"size": 1}', "t.json: parts: expected a list, got {'size': 1}"),
    ],
)
def test_messages_name_the_file_and_the_member(members, message):
    with pytest.raises(FormatError) as caught:
        decode("t.json", f"{HEAD}, {members}}}", Thing)
    assert message in str(caught.value)
    assert caught.value.path == "t.json"


@pytest.mark.parametrize(
    "value", [np.nan, np.inf, -np.inf, np.float64("nan"), np.float32("inf"), np.array(np.nan)]
)
def test_what_is_not_finite_is_null(value):
    text = encode(Thing(weight_kg=value))
    assert json.loads(text)["weight_kg"] is None
    assert decode("t.json", text, Thing).weight_kg is None


def test_arrays_are_lists():
    plain = to_plain({"rows": np.array([[1.0, np.nan]]), "count": np.int64(3)})
    assert plain == {"rows": [[1.0, None]], "count": 3}
    with pytest.raises(TypeError, match="object is no plain value"):
        to_plain(object())


@pytest.mark.parametrize(
    ("head", "error", "message"),
    [
        ('"format": "a thing", "version": 3', VersionError, "expected version 2, got 3"),
        ('"format": "a thing", "version": 0', FormatError, "version of at least 1, got 0"),
        ('"format": "a thing", "version": true', FormatError, "at least 1, got True"),
        ('"format": "a thing", "version": "2"', FormatError, "at least 1, got '2'"),
        ('"format": "a thing"', FormatError, "at least 1, got None"),
        ('"format": "another", "version": 2', FormatError, 'expected "format": "a thing", got'),
        ('"version": 2', FormatError, 'expected "format": "a thing", got None'),
    ],
)
def test_a_document_says_what_it_is(head, error, message):
    with pytest.raises(error) as caught:
        decode("t.json", f'{{{head}, "weight_kg": 1}}', Thing)
    assert message in str(caught.value)
    assert type(caught.value) is error


def test_earlier_versions_are_read():
    text = '{"format": "a thing", "version": 1, "weight_kg": 1}'
    assert decode("t.json", text, Thing) == Thing(weight_kg=1.0)


def test_members_that_a_later_program_added_are_passed_over():
    text = f'{HEAD}, "weight_kg": null, "colour": {{"a": [1]}}, "parts": [{{"size": 1, "b": 2}}]}}'
    assert decode("t.json", text, Thing) == Thing(weight_kg=None, parts=(Part(1),))
    assert convert("scene.toml", {"size": 1, "b": 2}, Part) == Part(1)


@pytest.mark.parametrize("text", ["[]", "3", '"a thing"', "null", "true"])
def test_what_is_no_object_is_refused(text):
    with pytest.raises(FormatError, match="t.json: expected a .*, got no object"):
        decode("t.json", text, Thing)
    with pytest.raises(FormatError, match="t.json: expected a table, got"):
        decode("t.json", text, Part)


@pytest.mark.parametrize(
    "text", ["", "{", "not JSON", HEAD, b"\xff\xfe\x00{", "[" * 100_000, "9" * 5000]
)
def test_what_is_no_json_is_refused(text):
    with pytest.raises(FormatError, match="expected JSON") as caught:
        decode("t.json", text, Thing)
    assert caught.value.path == "t.json"


def test_the_line_of_broken_json_is_named():
    with pytest.raises(FormatError) as caught:
        decode("t.json", '{"format":\n "a thing",\n oops}', Thing)
    assert str(caught.value).startswith("t.json:3: expected JSON")
