"""The rows of docs/guide/running/readers.md: their files, what is measured, and the page's tables.

`PYTHONPATH=tests .venv/bin/python -m support.services.reader_rows` writes the tables into the page;
with `--measure` it prints what the installed versions give where that is not what a row says.
"""

import math
import re
import sys
import tempfile
import tomllib
from importlib.metadata import version
from pathlib import Path

import trimesh
from scripts.pages import filled
from support.paths import CHECKOUT

from stepbus_schemas.tables import table

from .readers import READERS

PAGE = CHECKOUT / "docs/guide/running/readers.md"
DATA = tomllib.loads((CHECKOUT / "tests/services/readers/rows.toml").read_text(encoding="utf-8"))
ROWS, TOLD, VERSIONS = DATA["row"], DATA["told"], DATA["versions"]
_WITHIN = 0.01
_L = [(0, 0), (2, 0), (2, 1), (1, 1), (1, 2), (0, 2)]
_L_FACES = [(0, 1, 2), (0, 2, 3), (0, 3, 4), (0, 4, 5)]


def write(folder, row):
    """Write the robot of a row, and its mesh; return the robot's file."""
    text = DATA["models"][row["model"]]
    for before, after in zip(row.get("change", [])[::2], row.get("change", [])[1::2], strict=True):
        assert before in text, before
        text = text.replace(before, after)
    if "mesh" in row:
        (folder / "drawn").mkdir()
        write_mesh(folder / "drawn", row["mesh"])
        text = text.replace("MESH", row.get("url", "drawn/{}").format(row["mesh"], folder=folder))
    file = folder / "thing.urdf"
    file.write_text(text)
    return file


def write_mesh(folder, name):
    """Write a box of 0.6 x 0.4 x 0.2 m, or an L, as the name of the file says."""
    path, kind = folder / name, name.partition(".")[0]
    mesh = trimesh.creation.box((0.6, 0.4, 0.2))
    if kind == "l":
        mesh = trimesh.creation.extrude_triangulation(_L, _L_FACES, height=1.0)
    if kind == "mm":
        mesh.apply_scale(1000)
    mesh.export(path, file_type="stl_ascii" if kind == "text" else None)
    match kind:
        case "mm":
            unit = '<unit name="mm" meter="0.001"/>'
            path.write_text(path.read_text().replace("<up_axis>", f"{unit}<up_axis>"))
        case "y_up":
            path.write_text(path.read_text().replace("Z_UP", "Y_UP"))
        case "dots":
            path.write_text(re.sub(r"(?<=[ -])0\.", ".", path.read_text()))
        case "flat":
            content = bytearray(path.read_bytes())
            for start in range(84, len(content), 50):
                content[start : start + 12] = bytes(12)
            path.write_bytes(content)


def measured(row, key, folder):
    """Return what a reader makes of a row, and what it says: warnings, or why it refuses."""
    probe = dict(row["probe"])
    reader = READERS[key](write(folder, row))
    try:
        value = getattr(reader, probe.pop("name"))(**probe)
    except Exception as exc:
        if isinstance(exc, (AttributeError, NameError, TypeError)):
            raise
        return "refused", str(exc)
    said = reader.notes() if hasattr(reader, "notes") else ""
    if value is None or isinstance(value, str):
        return value or "nothing", said
    return float(value), said


def expected(row, key):
    """Return the value and the words of a cell."""
    cell = row[key]
    return cell if isinstance(cell, list) else [cell, ""]


def is_same(row, found, value):
    if isinstance(found, str) or isinstance(value, str):
        return found == value
    return math.isclose(
        found, value, rel_tol=row.get("within", _WITHIN), abs_tol=row.get("near", 1e-9)
    )


def difference(row, key, folder):
    """Return a sentence about what differs from a row; empty: nothing."""
    (value, _), (found, said) = expected(row, key), measured(row, key, folder)
    who, told = READERS[key], shown(value)
    name = f"{who.package} {version(who.package)} ({key})"
    if not is_same(row, found, value):
        then = VERSIONS.get(key, "now")
        return f"{name}, {row['what']}, {row['asked']}: {shown(found)}; the page says {told} ({then}). {said}"
    if key.startswith("stepbus") and (words := says(row, key)) not in said:
        return f"{name}, {row['what']}: does not say {words!r} but {said!r}"
    return ""


def says(row, key):
    words = row.get("says", "")
    return words if isinstance(words, str) else words.get(key, "")


def shown(value):
    if isinstance(value, str):
        return value
    return "∞" if math.isinf(value) else f"{value:.4g}".replace("e-0", "e-").replace("-", "−", 1)


def cell(row, key):
    if key not in row:
        return ""
    value, words = expected(row, key)
    return f"{shown(value)}: {words}" if words else shown(value)


def tables():
    """Return the parts of the page."""
    names = {"pybullet": "PyBullet", "mujoco": "MuJoCo", "pinocchio": "Pinocchio"}
    head = [f"{name} {VERSIONS[key]}" for key, name in names.items()]
    head = ["In the file: measured", *head, "stepbus, PyBullet", "stepbus, MuJoCo", "Notes"]
    parts = {}
    for row in ROWS:
        cells = [cell(row, key) for key in READERS]
        parts.setdefault(row["part"], []).append(
            [f"{row['what']}: {row['asked']}", *cells, row.get("note", "")]
        )
    text = "\n".join(f"### {part}\n\n{table(head, rows)}" for part, rows in parts.items())
    told = table(
        ["Matter", "What happens", "Shown by"],
        [[t["what"], t["text"], f"`{t['shown']}`"] for t in TOLD],
    )
    return {"rows": text, "told": told}


if __name__ == "__main__":
    if "--measure" not in sys.argv:
        PAGE.write_text(filled(PAGE.read_text(encoding="utf-8"), tables()), encoding="utf-8")
        sys.exit()
    for one in ROWS:
        for reader in filter(one.__contains__, READERS):
            with tempfile.TemporaryDirectory() as scratch:
                if sentence := difference(one, reader, Path(scratch)):
                    print(sentence)
