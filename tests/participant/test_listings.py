"""Modules that are written while a process runs."""

import importlib.util
import os

from stepbus_participant import forget_listings


def test_a_module_that_is_written_after_its_folder_was_listed_is_found(tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(tmp_path)
    before = tmp_path.stat()
    assert importlib.util.find_spec("written_later") is None
    (tmp_path / "written_later.py").touch()
    # As on a disk whose clock is coarse.
    os.utime(tmp_path, ns=(before.st_atime_ns, before.st_mtime_ns))
    assert importlib.util.find_spec("written_later") is None
    forget_listings()
    assert importlib.util.find_spec("written_later") is not None
