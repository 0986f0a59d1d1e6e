"""The files around a release: versions, workflows, container files, catalogue of schemas."""

import json
import re
import tomllib
from fnmatch import fnmatch

import pytest
import yaml
from jsonschema import Draft202012Validator
from scripts.release_readme import with_addresses
from support.paths import CHECKOUT

from stepbus_orchestrator.scenario.load import load

PROJECTS = [
    tomllib.loads((CHECKOUT / name).read_text(encoding="utf-8"))
    for name in ("pyproject.toml", "store/pyproject.toml")
]
VERSION = PROJECTS[0]["project"]["version"]
WORKFLOWS = sorted((CHECKOUT / ".github/workflows").glob("*.yml"))
CATALOGUE = json.loads((CHECKOUT / "schemas/schemastore.json").read_text())["schemas"]
ADDRESS = "https://github.com/stepbus/stepbus"
RAW = "https://raw.githubusercontent.com/stepbus/stepbus/main/"


def test_every_file_that_names_the_version_names_the_same():
    citation = yaml.safe_load((CHECKOUT / "CITATION.cff").read_text())
    assert PROJECTS[1]["project"]["version"] == citation["version"] == VERSION
    ours = re.compile(r"^stepbus\[sim\]>=(\d+\.\d+),<(\d+\.\d+)$")
    (match,) = filter(None, map(ours.match, PROJECTS[1]["project"]["dependencies"]))
    assert VERSION.startswith(f"{match[1]}.")


def test_the_page_of_the_package_leads_to_the_tag_of_its_version():
    page = "[a](docs/x.md#b) ![c](p/d.gif) [e](https://f) [g](#h) [![i](j.png)](k.md)"
    assert with_addresses(page, "1.2.0") == (
        f"[a]({ADDRESS}/blob/v1.2.0/docs/x.md#b) "
        f"![c]({RAW.replace('main', 'v1.2.0')}p/d.gif) [e](https://f) [g](#h) "
        f"[![i]({RAW.replace('main', 'v1.2.0')}j.png)]({ADDRESS}/blob/v1.2.0/k.md)"
    )


def test_both_projects_name_the_same_repository():
    urls = [project["project"]["urls"]["Repository"] for project in PROJECTS]
    assert urls == [ADDRESS, ADDRESS]


def test_the_licence_of_the_store_is_that_of_the_repository():
    assert (CHECKOUT / "store/LICENSE").read_bytes() == (CHECKOUT / "LICENSE").read_bytes()


@pytest.mark.parametrize("project", PROJECTS, ids=["stepbus", "stepbus-store"])
def test_the_sdist_lists_every_package_of_the_wheel(project):
    targets = project["tool"]["hatch"]["build"]["targets"]
    assert set(targets["wheel"]["packages"]) <= set(targets["sdist"]["only-include"])


def test_an_upper_bound_says_why_it_is_there():
    text = (CHECKOUT / "pyproject.toml").read_text(encoding="utf-8")
    bounded = re.findall(r'^    "(?!stepbus)[\w.-]+>=[^",]+,<[^"]+",(.*)$', text, re.MULTILINE)
    assert len(bounded) >= 8
    assert [rest for rest in bounded if not rest.strip().startswith("# ")] == []


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


def test_what_is_published_is_what_was_checked():
    (check,) = (
        step["run"]
        for name, step in steps(CHECKOUT / ".github/workflows/release.yml")
        if "release_check" in step.get("run", "")
    )
    assert "--out dist" in check
    assert '--tag "$GITHUB_REF_NAME"' in check
    assert "--only" not in check


def test_every_file_that_the_containerfile_copies_exists():
    text = (CHECKOUT / "Containerfile").read_text().replace("\\\n", " ")
    lines = [line.split()[1:-1] for line in text.splitlines() if line.startswith("COPY ")]
    copied = [name for words in lines if not words[0].startswith("--from") for name in words]
    assert [name for name in copied if not (CHECKOUT / name).exists()] == []
    packages = PROJECTS[0]["tool"]["hatch"]["build"]["targets"]["wheel"]["packages"]
    assert {package.partition("/")[0] for package in packages} <= set(copied)


def test_the_devcontainer_sets_the_clone_up_by_make():
    value = json.loads((CHECKOUT / ".devcontainer/devcontainer.json").read_text())
    assert value["image"].endswith(":3.11-bookworm")
    assert value["postCreateCommand"] == "make setup PYTHON3=python3.11"


@pytest.mark.parametrize("entry", CATALOGUE, ids=lambda entry: entry["name"])
def test_the_catalogue_leads_to_valid_schemas_that_state_their_draft(entry):
    assert entry.keys() == {"name", "description", "fileMatch", "url"}
    assert entry["url"].startswith(RAW)
    schema = json.loads((CHECKOUT / entry["url"].removeprefix(RAW)).read_text())
    assert schema["$schema"] == Draft202012Validator.META_SCHEMA["$id"]
    Draft202012Validator.check_schema(schema)


def test_a_scenario_with_the_name_of_the_catalogue_is_valid_and_is_loaded(tmp_path):
    source = CHECKOUT / "scenarios/stepbus_scenarios/two_link"
    for path in source.glob("*.*"):
        (tmp_path / path.name).write_bytes(path.read_bytes())
    path = (tmp_path / "scenario.yaml").rename(tmp_path / "arm.stepbus.yaml")
    scenario, world = CATALOGUE
    assert fnmatch(path.name, scenario["fileMatch"][0])
    assert not fnmatch(path.name, world["fileMatch"][0])
    schema = json.loads((CHECKOUT / scenario["url"].removeprefix(RAW)).read_text())
    Draft202012Validator(schema).validate(yaml.safe_load(path.read_text()))
    assert load(str(path)).name == "two_link"


def test_the_form_for_bugs_asks_for_doctor_and_for_the_recording():
    form = yaml.safe_load((CHECKOUT / ".github/ISSUE_TEMPLATE/bug.yml").read_text())
    needed = {
        part["id"] for part in form["body"] if part.get("validations", {}).get("required") is True
    }
    assert {"doctor", "recording"} <= needed
