"""`stepbus completion`: what a shell needs to complete commands, options, scenarios and files."""

import re
import sys
from collections.abc import Iterable
from typing import Annotated, Literal

from stepbus_orchestrator.cli.commands import make_parser
from stepbus_orchestrator.cli.overview import command_names
from stepbus_orchestrator.cli.parameters import command
from stepbus_orchestrator.scenario.locate import builtin_names
from stepbus_participant import need

# The functions that `parameters.COMPLETIONS` names.
_PLAIN = re.compile(r"[\w./-]+")
_FUNCTIONS = {
    "bash": """
_stepbus_glob_commands() {{ compgen -W '{commands}' -- "$1"; }}
_stepbus_glob_scenarios() {{
  compgen -W '{scenarios}' -- "$1"
  compgen -f -X '!*.yaml' -- "$1"
  compgen -d -- "$1"
}}
_stepbus_glob_recordings() {{
  compgen -f -X '!*.mcap' -- "$1"
  compgen -d -- "$1"
}}
""",
    "zsh": """
_stepbus_glob_commands() {{ compadd -- {commands}; }}
_stepbus_glob_scenarios() {{
  compadd -- {scenarios}
  _files -g '*.yaml'
}}
_stepbus_glob_recordings() {{ _files -g '*.mcap'; }}
""",
    "fish": """
function _stepbus_glob_commands
  printf '%s\n' {commands}
end
function _stepbus_glob_scenarios
  printf '%s\n' {scenarios}
  __fish_complete_suffix .yaml
end
function _stepbus_glob_recordings
  __fish_complete_suffix .mcap
end
""",
}


@command()
def completion_command(
    shell: Annotated[Literal["bash", "zsh", "fish"], {"help": "shell"}],
) -> int:
    """Print the completion script of a shell.

    Completes commands, options, names of scenarios, recordings (*.mcap) and other files. The script
    lists what is installed when you print it. To try it in bash: `source <(stepbus completion
    bash)`. See docs/reference/cli.md for where each shell keeps it.

    $ stepbus completion bash
    $ stepbus completion zsh
    $ stepbus completion fish
    """
    (shtab,) = need("stepbus completion", "shtab")
    functions = _FUNCTIONS[shell].format(
        commands=_words((*command_names(), "which")), scenarios=_words(builtin_names())
    )
    parser = make_parser()
    for sub in parser.commands:
        # Beside the name of a command, zsh and fish show its summary only.
        sub.description = None
    sys.stdout.write(shtab.complete(parser, shell=shell, preamble=functions) + "\n")
    return 0


def _words(names: Iterable[str]) -> str:
    """Return those names that no shell takes for anything else."""
    return " ".join(name for name in names if _PLAIN.fullmatch(name))
