"""Make an FMU of a program and its model description: `python pack.py drives.so drives.fmu`.

The same files give the same bytes.
"""

import sys
import zipfile
from pathlib import Path

from fmpy import platform, sharedLibraryExtension

library, target = map(Path, sys.argv[1:])
parts = {
    "modelDescription.xml": Path("modelDescription.xml"),
    f"binaries/{platform}/{library.stem}{sharedLibraryExtension}": library,
}
with zipfile.ZipFile(target, "w", zipfile.ZIP_DEFLATED) as archive:
    for name, path in sorted(parts.items()):
        # Without a time of its own: that of 1980.
        archive.writestr(zipfile.ZipInfo(name), path.read_bytes(), zipfile.ZIP_DEFLATED)
