"""Each row of docs/guide/running/readers.md is true of the readers that are installed."""

import re
from importlib.util import find_spec

import pytest
from support.paths import CHECKOUT
from support.services import reader_rows
from support.services.readers import READERS
from support.tools import needs_opengl

CELLS = [(row, key) for row in reader_rows.ROWS for key in READERS if key in row]
IDS = [re.sub(r"\W+", "_", f"{row['what']} {row['asked']} {key}") for row, key in CELLS]


@pytest.mark.parametrize(("row", "key"), CELLS, ids=IDS)
def test_a_reader_makes_of_a_file_what_the_page_says(tmp_path, row, key):
    engine = READERS[key].module
    if find_spec(engine) is None:
        pytest.skip(f"{engine} is not installed")
    if row["probe"]["name"] == "colour" and key == "stepbus_mujoco":
        needs_opengl(engine)
    assert reader_rows.difference(row, key, tmp_path) == ""


def test_the_tables_of_the_page_are_those_of_the_rows():
    text = reader_rows.PAGE.read_text(encoding="utf-8")
    command = "PYTHONPATH=tests .venv/bin/python -m support.services.reader_rows"
    assert reader_rows.filled(text, reader_rows.tables()) == text, command


@pytest.mark.parametrize("told", reader_rows.TOLD, ids=lambda told: told["shown"])
def test_what_other_tests_and_findings_show_is_there(told):
    file, _, name = told["shown"].partition("::")
    assert (
        f"def {name}(" in (CHECKOUT / file).read_text(encoding="utf-8")
        if name
        else (CHECKOUT / file).is_file()
    )
