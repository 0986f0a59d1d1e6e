"""Disks of a chosen size."""

import os
import subprocess

import pytest
from support.surroundings import comes_true


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
        # A library may close what it has read on a thread of its own, a moment later.
        assert comes_true(lambda disk=disk: unmounted(disk)), f"{disk} is still used"


def unmounted(disk):
    """Unmount a disk; return whether nothing used it any more."""
    return subprocess.run(["umount", disk], check=False, capture_output=True).returncode == 0
