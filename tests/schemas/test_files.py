import json
from pathlib import Path

import jsonschema
import pytest
from scripts.generate_messages import generated_files, main, stale_files, write
from support.messages.vectors import CHECKOUT, TYPES

from stepbus_schemas import WiringError, json_schema


def test_the_checked_in_files_are_what_the_types_say() -> None:
    stale = stale_files(CHECKOUT)
    assert stale == [], "run `python -m scripts.generate_messages`"


def test_every_type_has_a_schema_file() -> None:
    names = {path.name for path in (CHECKOUT / "schemas/json").iterdir()}
    names -= {"scenario.schema.json", "world.schema.json"}
    assert names == {f"{name.replace('/', '.')}.json" for name in TYPES}


@pytest.mark.parametrize("type_name", TYPES)
def test_every_json_schema_is_a_schema(type_name: str) -> None:
    schema = json_schema(type_name)
    jsonschema.Draft202012Validator.check_schema(schema)
    assert schema["type"] == "object"


@pytest.mark.parametrize("type_name", TYPES)
def test_every_field_has_a_description(type_name: str) -> None:
    schema = json_schema(type_name)
    bare = [
        f"{part['title']}.{name}"
        for part in (schema, *schema.get("$defs", {}).values())
        for name, field in part["properties"].items()
        if not field.get("description")
    ]
    assert bare == []


def test_a_log_holds_nested_outputs() -> None:
    schema = json_schema("Log/1")
    assert schema["properties"]["outputs"]["items"] == {"$ref": "#/$defs/Outputs"}


def test_there_is_no_json_schema_of_an_unknown_type() -> None:
    with pytest.raises(WiringError, match="'JointState/2'; known: JointState/1"):
        json_schema("JointState/2")


def test_writing_into_an_empty_folder_makes_every_file(tmp_path: Path) -> None:
    assert set(write(tmp_path)) == set(generated_files(tmp_path))
    assert stale_files(tmp_path) == []


def test_a_changed_file_is_found_and_put_right(tmp_path: Path) -> None:
    write(tmp_path)
    page = tmp_path / "docs/reference/messages.md"
    page.write_text("changed by hand")
    assert stale_files(tmp_path) == [page] == write(tmp_path)


def test_the_schema_of_a_type_that_is_gone_is_removed(tmp_path: Path) -> None:
    write(tmp_path)
    left_over = tmp_path / "schemas/json/Gone.1.json"
    left_over.write_text("{}")
    assert write(tmp_path) == [left_over]
    assert not left_over.exists()


def test_check_names_what_is_stale_and_fails(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("scripts.generate_messages.CHECKOUT", tmp_path)
    assert main(["--check"]) == 1
    assert "schemas/vectors.json: out of date" in capsys.readouterr().out


def test_vectors_are_json_that_any_parser_takes() -> None:
    def refuse(constant: str) -> None:
        raise AssertionError(f"{constant} is not JSON")

    text = (CHECKOUT / "schemas/vectors.json").read_text(encoding="utf-8")
    assert json.loads(text, parse_constant=refuse)["notation"]
