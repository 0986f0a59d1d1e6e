"""Disks of a chosen size."""

import os
import subprocess

import pytest


@pytest.fixture
def small_disk(tmp_path):
    """Return a function that makes a folder with room for so much."""
    mounted = []

    def make(size):
        disk = tmp_path / f"disk{len(mounted)}"
        disk.mkdir()
        command = ["mount", "-t", "tmpfs", "-o", f"size={size}", "none", disk]
        if os.geteuid() != 0 or subprocess.run(command, check=False).returncode:
            pytest.skip("this machine does not let us mount a tmpfs")
        mounted.append(disk)
        return disk

    yield make
    for disk in mounted:
        subprocess.run(["umount", disk], check=True)
