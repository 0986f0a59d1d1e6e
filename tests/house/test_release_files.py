"""The files around a release: versions, workflows, container files, catalogue of schemas."""

import json
import re
import tomllib

import pytest
import yaml
from jsonschema import Draft202012Validator
from support.paths import CHECKOUT

PROJECTS = [
    tomllib.loads((CHECKOUT / name).read_text(encoding="utf-8"))
    for name in ("pyproject.toml", "store/pyproject.toml")
]
VERSION = PROJECTS[0]["project"]["version"]
WORKFLOWS = sorted((CHECKOUT / ".github/workflows").glob("*.yml"))
CATALOGUE = json.loads((CHECKOUT / "schemas/schemastore.json").read_text())["schemas"]
RAW = "https://raw.githubusercontent.com/stepbus/stepbus/main/"


def test_every_file_that_names_the_version_names_the_same():
    citation = yaml.safe_load((CHECKOUT / "CITATION.cff").read_text())
    assert PROJECTS[1]["project"]["version"] == citation["version"] == VERSION
    ours = re.compile(r"^stepbus\[sim\]>=(\d+\.\d+),<(\d+\.\d+)$")
    (match,) = filter(None, map(ours.match, PROJECTS[1]["project"]["dependencies"]))
    assert VERSION.startswith(f"{match[1]}.")


@pytest.mark.parametrize("project", PROJECTS, ids=["stepbus", "stepbus-store"])
def test_the_sdist_lists_every_package_of_the_wheel(project):
    targets = project["tool"]["hatch"]["build"]["targets"]
    assert set(targets["wheel"]["packages"]) <= set(targets["sdist"]["only-include"])


def steps(workflow):
    """Yield (name of the job, step) of a workflow."""
    for name, job in yaml.safe_load(workflow.read_text())["jobs"].items():
        for step in job["steps"]:
            yield name, step


@pytest.mark.parametrize("workflow", WORKFLOWS, ids=lambda path: path.name)
def test_every_action_is_pinned_to_a_commit_and_names_its_version(workflow):
    used = re.findall(r"^ *- uses: (.*)$", workflow.read_text(), re.MULTILINE)
    assert used
    pinned = re.compile(r"[\w.-]+/[\w.-]+@[0-9a-f]{40}  # v\d+\.\d+\.\d+")
    assert [line for line in used if not pinned.fullmatch(line)] == []


@pytest.mark.parametrize("workflow", WORKFLOWS, ids=lambda path: path.name)
def test_every_make_target_of_a_workflow_exists(workflow):
    targets = re.findall(r"^([a-z-]+):", (CHECKOUT / "Makefile").read_text(), re.MULTILINE)
    named = [
        word
        for _, step in steps(workflow)
        for word in re.findall(r"make ([a-z][a-z-]*)", step.get("run", ""))
    ]
    assert named
    assert set(named) <= set(targets)


def test_only_the_job_that_publishes_may_ask_for_an_identity():
    jobs = {
        name: job
        for workflow in WORKFLOWS
        for name, job in yaml.safe_load(workflow.read_text())["jobs"].items()
    }
    assert {name for name, job in jobs.items() if "id-token" in job["permissions"]} == {"publish"}
    assert jobs["publish"]["permissions"] == {"id-token": "write"}
    assert jobs["publish"]["environment"] == "release"
    others = [job["permissions"] for name, job in jobs.items() if name != "publish"]
    assert all(permissions == {"contents": "read"} for permissions in others)


def test_every_file_that_the_containerfile_copies_exists():
    text = (CHECKOUT / "Containerfile").read_text().replace("\\\n", " ")
    lines = [line.split()[1:-1] for line in text.splitlines() if line.startswith("COPY ")]
    copied = [name for words in lines if not words[0].startswith("--from") for name in words]
    assert [name for name in copied if not (CHECKOUT / name).exists()] == []
    packages = PROJECTS[0]["tool"]["hatch"]["build"]["targets"]["wheel"]["packages"]
    assert {package.partition("/")[0] for package in packages} <= set(copied)


@pytest.mark.parametrize("entry", CATALOGUE, ids=lambda entry: entry["name"])
def test_the_catalogue_leads_to_valid_schemas_that_state_their_draft(entry):
    assert entry.keys() == {"name", "description", "fileMatch", "url"}
    assert entry["url"].startswith(RAW)
    schema = json.loads((CHECKOUT / entry["url"].removeprefix(RAW)).read_text())
    assert schema["$schema"] == Draft202012Validator.META_SCHEMA["$id"]
    Draft202012Validator.check_schema(schema)
