"""Programs that a test needs and a machine may lack: without them it is skipped, with a word."""

import os
import shutil
import subprocess
from ctypes.util import find_library
from importlib.util import find_spec

import pytest
from support.paths import CHECKOUT

needs_pybullet = pytest.mark.skipif(
    find_spec("pybullet") is None,
    reason="pybullet is not installed: it has no wheels for Python 3.12 and later",
)
"""Marks a test of what only PyBullet has. Its world or its params name the engine."""


def needs(*programs):
    """Skip the test where one of the programs is not on PATH."""
    for program in programs:
        if shutil.which(program) is None:
            pytest.skip(f"{program} is not installed")


def needs_opengl(engine):
    """Skip the test of an engine's images where OpenGL is not installed, which MuJoCo draws with."""
    if engine == "mujoco" and "MUJOCO_GL" not in os.environ and find_library("EGL") is None:
        pytest.skip("MuJoCo cannot render images: libEGL is not installed")


needs_store = pytest.mark.skipif(
    find_spec("stepbus_store") is None, reason="stepbus-store is not installed: `make robots`"
)

needs_robots = pytest.mark.skipif(
    find_spec("xacro") is None, reason="xacro and the robots are not installed: `make robots`"
)


def tracked(folder):
    """Return the files of a folder of the checkout that no build has made, relative to it.

    Skips the test where git cannot tell: in an unpacked archive, or in a checkout of another user.
    """
    needs("git")
    command = ["git", "ls-files", "--cached", "--others", "--exclude-standard"]
    pipes = {"capture_output": True, "text": True}
    listed = subprocess.run(command, check=False, cwd=CHECKOUT / folder, **pipes)
    if listed.returncode:
        pytest.skip(f"this is no checkout of git: {listed.stderr.strip()}")
    return set(listed.stdout.splitlines())


def fake(folder, name, text="#!/bin/sh\n"):
    """Write a program that does nothing, for a test that only looks it up; return its folder."""
    folder.mkdir(exist_ok=True)
    (folder / name).write_text(text)
    (folder / name).chmod(0o755)
    return folder
