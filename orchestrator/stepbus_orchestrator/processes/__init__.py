"""The processes of a run: started, watched, ended."""

import os

PYTHON = {
    # One thread for each BLAS: more only compete for the cores the lockstep runs on.
    "OMP_NUM_THREADS": "1",
    "OPENBLAS_NUM_THREADS": "1",
    "PYTHONUNBUFFERED": "1",
    # The order of a set of texts is the same in every run.
    "PYTHONHASHSEED": "0",
}
"""The environment of Python participants, in a process of their own or in a shared one."""


def can_host() -> bool:
    """Return whether this process has it, and hosts participants as their own would."""
    return all(os.environ.get(name) == value for name, value in PYTHON.items())
