"""Runs a sweep of two_link on a cluster of three nodes, one of which is killed in the middle.

Usage: losing_a_node.py FOLDER WORDS-OF-THE-SWEEP…
"""

import os
import shutil
import sys
import tempfile
import threading
import time
from pathlib import Path

temporary = tempfile.mkdtemp(prefix="n-")
os.environ |= {"RAY_AUTH_MODE": "disabled", "RAY_USAGE_STATS_ENABLED": "0", "RAY_TMPDIR": temporary}
os.environ["TMPDIR"] = temporary  # the node that is killed cannot remove its folder
(Path(temporary) / "ray").mkdir()

from ray.cluster_utils import Cluster  # noqa: E402  (Ray reads the environment when it is imported)

from stepbus_orchestrator.cli.dispatch import execute  # noqa: E402

folder = Path(sys.argv[1])
cluster = Cluster(
    initialize_head=True,
    head_node_args={"num_cpus": 1, "include_dashboard": False},
)
victim = cluster.add_node(num_cpus=1)
cluster.add_node(num_cpus=1)


def lose_a_node() -> None:
    journal = folder / "rows.jsonl"
    while not journal.exists() or journal.read_bytes().count(b"\n") < 10:
        time.sleep(0.02)
    cluster.remove_node(victim, allow_graceful=False)


threading.Thread(target=lose_a_node, daemon=True).start()
try:
    code = execute(
        ["sweep", "two_link", *sys.argv[2:], "--out", str(folder), "--address", cluster.address]
    )
finally:
    cluster.shutdown()
    shutil.rmtree(temporary, ignore_errors=True)
sys.exit(code)
