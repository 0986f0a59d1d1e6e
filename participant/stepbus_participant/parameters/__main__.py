"""Check parameters that files of a scenario's folder declare: a process of its own runs them.

It reads a list of requests as JSON, `{"file": …, "module": …, "name": …, "params": …}`, and writes
for each a list of problems, `[keys, message]`. The orchestrator starts it, in the scenario's
folder, so that no code of the user's runs in the orchestrator itself.
"""

import contextlib
import importlib
import importlib.util
import json
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from stepbus_schemas import WiringError, error_text

from .problems import Keys
from .read import find_problems
from .settings import Settings


def main() -> int:
    """Answer the requests on standard input; what imported modules print goes to stderr."""
    requests = json.load(sys.stdin)
    # Only from here on: `python -P` has loaded what is installed, not what the folder calls alike.
    sys.path.insert(0, str(Path.cwd()))
    with contextlib.redirect_stdout(sys.stderr):
        answers = [_check(request) for request in requests]
    json.dump(answers, sys.stdout)
    return 0


def _check(request: Mapping[str, Any]) -> list[tuple[Keys, str]]:
    try:
        declared = getattr(_module(request), request["name"])
        is_declared = isinstance(declared, type) and issubclass(declared, Settings)
        return find_problems(declared, request["params"], Path.cwd()) if is_declared else []
    except (Exception, SystemExit) as exc:  # noqa: BLE001  code of the user's
        text = f"{request['file']} cannot be imported to check them: {error_text(exc)}"
        return [((), text)]


def _module(request: Mapping[str, Any]) -> Any:
    """Import a module by name, or a script by its file."""
    if request["module"]:
        return importlib.import_module(request["module"])
    sys.path.insert(0, str(Path(request["file"]).parent))
    spec = importlib.util.spec_from_file_location("script", request["file"])
    if spec is None or spec.loader is None:
        raise WiringError("is no Python file")
    module = importlib.util.module_from_spec(spec)
    sys.modules["script"] = module
    spec.loader.exec_module(module)
    return module


if __name__ == "__main__":
    sys.exit(main())
