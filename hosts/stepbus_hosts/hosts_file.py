"""The file of `--hosts`: where the hosts are that a scenario names."""

from collections.abc import Iterator
from pathlib import Path

from stepbus_participant import Name, Settings, Text
from stepbus_participant.parameters import Keys, read, read_yaml
from stepbus_schemas import WiringError

from .addresses import parse_address


class HostSpec(Settings):
    """A host that is reached over SSH."""

    address: Text
    """Host name, address, or name in your SSH configuration."""
    user: str = ""
    """User there. Default: as your SSH configuration says."""
    python: Text = "python3"
    """Python there, in which stepbus is installed, such as `/home/ada/.venv/bin/python`."""
    folder: Text = "~/.cache/stepbus"
    """Folder there for the files of scenarios, by their content."""
    ssh: tuple[str, ...] = ()
    """Further options of `ssh`, such as `[-p, "2222", -J, jump]`."""
    reaches: str = ""
    """`ADDRESS[:PORT]` by which it reaches this host, where that is not the address on which the
    run listens: behind a router that forwards a port."""

    compress: bool = False
    """Whether what goes to and from it is compressed (LZ4): for images over a slow network."""

    def problems(self) -> Iterator[tuple[Keys, str]]:
        """Yield that `reaches` is no address."""
        try:
            if self.reaches:
                parse_address(self.reaches)
        except WiringError as exc:
            yield ("reaches",), str(exc)

    @property
    def destination(self) -> str:
        """Return what `ssh` is to connect to."""
        return f"{self.user}@{self.address}" if self.user else self.address


def read_hosts(path: Path) -> dict[str, HostSpec]:
    """Return name → host; raises SettingsError with all that is wrong, and where."""
    file = read_yaml(path, "a map: name of a host → its address")
    problems = file.problems()
    hosts = read(dict[Name, HostSpec], file.data, problems)
    problems.refuse()
    return hosts
