"""A newcomer sees at most a dozen entries in each folder of the source and the tests."""

import subprocess
from collections import defaultdict
from pathlib import PurePath

from support.paths import CHECKOUT

ROOMS = ("api", "orchestrator", "participant", "schemas/stepbus_schemas", "services", "tests")
UNSEEN = {"__init__.py", "py.typed"}
"""Files that say nothing of what a folder holds."""


def test_no_folder_has_more_than_a_dozen_entries():
    listed = subprocess.run(
        ["git", "ls-files", *ROOMS], cwd=CHECKOUT, capture_output=True, text=True, check=True
    )
    entries = defaultdict(set)
    for file in map(PurePath, listed.stdout.splitlines()):
        for path in (file, *file.parents):
            entries[path.parent].add(path.name)
    crowded = {str(folder): len(names - UNSEEN) for folder, names in entries.items()}
    crowded.pop(".")
    assert {folder: count for folder, count in crowded.items() if count > 12} == {}
