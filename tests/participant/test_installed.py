"""The versions of packages that a recording holds."""

from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

import pytest

from stepbus_participant import installed_version


@pytest.mark.parametrize("package", ["stepbus", "eclipse-zenoh", "msgspec", "ruamel.yaml"])
def test_a_version_is_that_of_importlib_metadata(package: str) -> None:
    assert installed_version(package) == version(package)


def test_a_package_beside_the_program_comes_first(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    folder = tmp_path / "Robot_Arm-2.0.dist-info"
    folder.mkdir()
    (folder / "METADATA").write_text("Metadata-Version: 2.1\nName: Robot.Arm\nVersion: 2.0\n")
    monkeypatch.syspath_prepend(str(tmp_path))
    assert installed_version("robot-arm") == version("robot-arm") == "2.0"


def test_a_package_that_is_not_installed_has_no_version() -> None:
    with pytest.raises(PackageNotFoundError, match="no_such_package"):
        installed_version("no_such_package")
