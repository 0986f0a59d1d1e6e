"""Without an extra there are two packages; what needs an extra names it."""

import importlib.metadata
import subprocess
import wave

OURS = {"pip", "setuptools", "stepbus"}
listed = {one.metadata["Name"] for one in importlib.metadata.distributions()} - OURS
assert listed == {"eclipse-zenoh", "msgspec"}, listed
assert wave.Cart
done = subprocess.run(["stepbus", "run", "two_link"], capture_output=True, text=True, check=False)
said = done.stdout + done.stderr
assert done.returncode in {1, 2}, said
assert "pip install" in said, said
assert "Traceback" not in said, said
