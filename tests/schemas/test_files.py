import json

import jsonschema
import pytest
from scripts.generate_messages import main
from support.messages.vectors import CHECKOUT, TYPES

from stepbus_schemas import json_schema


def test_the_checked_in_files_are_what_the_types_say(capsys) -> None:
    assert main(["--check"]) == 0, capsys.readouterr().out


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


def test_vectors_are_json_that_any_parser_takes() -> None:
    def refuse(constant: str) -> None:
        raise AssertionError(f"{constant} is not JSON")

    text = (CHECKOUT / "schemas/vectors.json").read_text(encoding="utf-8")
    assert json.loads(text, parse_constant=refuse)["notation"]
