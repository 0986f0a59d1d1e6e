"""About the commands: `stepbus help` and `completion`."""

from typing import Annotated, Literal

from cyclopts import Parameter

from stepbus_orchestrator.cli.parameters import command, later

_topics = later("stepbus_orchestrator.cli.completion:topics")


@command(execute="stepbus_orchestrator.cli.help:help_command")
def help_command(topic: Annotated[str, Parameter(completer=_topics)] = "", /) -> None:
    """Show the help of a command, or help to choose a command.

    Shows what a command does, its options and examples. `which` compares the five commands that
    compare runs. Without a topic, it lists all commands.

    Parameters
    ----------
    topic
        a command, or `which`

    Examples
    --------
    $ stepbus help run
    $ stepbus help which

    """


@command(execute="stepbus_orchestrator.cli.completion:completion_command")
def completion_command(shell: Literal["bash", "zsh", "fish"], /) -> None:
    """Print the completion script of a shell.

    Completes commands, options, names of scenarios, and files. The script lists the commands that
    are installed when you print it. To try it in bash: `source <(stepbus completion bash)`. See
    docs/reference/cli.md for where each shell keeps it.

    Parameters
    ----------
    shell
        bash, zsh or fish

    Examples
    --------
    $ stepbus completion bash
    $ stepbus completion zsh
    $ stepbus completion fish

    """
