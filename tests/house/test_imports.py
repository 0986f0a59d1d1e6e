"""Packages import from each other only what these export."""

import ast
from functools import cache

from support.exports import exported
from support.paths import CHECKOUT

SOURCE = (
    "api", "benchmarks", "docs", "examples", "orchestrator", "participant", "scenarios", "schemas",
    "services", "store/stepbus_store", "tools",
)  # fmt: skip
"""Where that holds. The campaign calls every reader of a recording, also those inside a package."""
EXPORTING = {
    "stepbus_participant.parameters",
    "stepbus_participant.parameters.settings",
    "stepbus_schemas.messages",
    *(f"stepbus_tools.{name}" for name in ("figures", "sweep.pool", "sweep.run_sweep", "sweep.spec", "viewing", "viewing.exports", "viewing.page")),
    *(f"stepbus.{name}" for name in ("errors", "messages", "params", "results", "wiring")),
    *(
        f"stepbus_orchestrator.{name}"
        for name in (
            "analysis.diff", "analysis.divergence", "analysis.findings", "analysis.signals",
            "analysis.tolerance", "analysis.verify", "cli", "cli.live", "cli.output",
            "cli.parameters", "cli.signals", "errors", "plugins", "processes", "processes.child",
            "processes.endpoints", "processes.launcher",
            "processes.limits", "processes.watchdog", "recording", "recording.layout",
            "recording.timing", "replay", "replay.branch", "replay.recorded", "replay.rerun",
            "replay.sources",
            "run.bus", "run.describe", "run.episode", "run.extension", "run.extensions.external",
            "run.extensions.pace", "run.extensions.real_time", "run.folder", "run.hosts",
            "run.inprocess.local_run", "run.kernel.admission", "run.kernel.descriptions", "run.live_file",
            "run.reports", "run.result", "run.run_scenario", "scenario.faults", "scenario.load", "scenario.model",
            "scenario.override", "scenario.program", "scenario.resolve",
        )
    ),
}  # fmt: skip
"""Modules that other packages may import from, beside the packages themselves."""
ONE = {"stepbus_gym": "stepbus", "stepbus_pytest": "stepbus"}
"""Packages that are part of another one."""


@cache
def imports():
    """Return all of `found_imports`."""
    return list(found_imports())


def found_imports():
    """Yield (file, module, names) of each import of ours from another package of ours."""
    for path in (path for top in SOURCE for path in sorted((CHECKOUT / top).rglob("*.py"))):
        name = str(path.relative_to(CHECKOUT))
        package = next(
            (part for part in path.relative_to(CHECKOUT).parts if part.startswith("stepbus")), ""
        )
        if "/templates/" in name:
            continue
        for node in ast.walk(ast.parse((CHECKOUT / name).read_text(encoding="utf-8"))):
            if isinstance(node, ast.ImportFrom) and not node.level:
                rows = [(node.module, tuple(alias.name for alias in node.names))]
            elif isinstance(node, ast.Import):
                rows = [(alias.name, ()) for alias in node.names]
            else:
                continue
            for module, names in rows:
                top = module.partition(".")[0]
                if top.startswith("stepbus") and top not in {package, ONE.get(package)}:
                    yield name, module, names


def test_packages_import_only_from_the_top_of_others():
    deep = {
        f"{file}: {module}"
        for file, module, _ in imports()
        if "." in module and module not in EXPORTING
    }
    assert deep == set()


def test_what_packages_import_is_exported():
    hidden = {
        f"{file}: {module}.{name}"
        for file, module, names in imports()
        for name in names
        if name != "*"  # exactly what is exported
        and f"{module}.{name}" not in EXPORTING
        and name not in exported(module)
    }
    assert hidden == set()
