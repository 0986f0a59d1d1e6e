"""The machine that a benchmark runs on: without it, a figure says little."""

import os
import platform
from pathlib import Path


def name() -> str:
    """Return processor, cores, system and Python in a line."""
    lines = Path("/proc/cpuinfo").read_text().splitlines()
    models = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return (
        f"{models[0] if models else platform.machine()}, {os.cpu_count()} cores, "
        f"{platform.system()} {platform.release().partition('-')[0]}, "
        f"Python {platform.python_version()}"
    )
