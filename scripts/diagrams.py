"""Draw the Mermaid diagrams of the docs as SVG, so that a page of the site loads no script.

    npm install --prefix /tmp/mermaid mermaid@11
    python scripts/diagrams.py /tmp/mermaid/node_modules/mermaid/dist/mermaid.min.js

`make docs` shows docs/pictures/<page>.svg in place of the block; it fails when the block has
changed and the drawing has not. Needs Chromium.
"""

import argparse
import hashlib
import re
import subprocess
import sys
import tempfile
from pathlib import Path

DOCS = Path(__file__).parents[1] / "docs"
BLOCK = re.compile(r"^```mermaid\n(.*?)^```$", re.DOTALL | re.MULTILINE)
PAGE = """<!doctype html><meta charset="utf-8"><body><script src="{library}"></script><script>
mermaid.initialize({{startOnLoad: false, theme: "neutral", htmlLabels: false,
  flowchart: {{htmlLabels: false}}, fontFamily: "sans-serif"}});
mermaid.render("diagram", {text}).then(({{svg}}) => {{ document.body.innerHTML = svg; }});
</script>"""
CHROMIUM = (
    "chromium --headless --no-sandbox --disable-gpu --disable-background-networking"
    " --disable-component-update --disable-sync --no-first-run --virtual-time-budget=20000"
)


def fingerprint(text: str) -> str:
    """Return the comment by which a drawing names the block that it shows."""
    return f"<!-- mermaid {hashlib.sha256(text.encode()).hexdigest()[:16]} -->"


def draw(text: str, library: Path) -> str:
    """Return a diagram as SVG."""
    literal = "`" + text.replace("\\", "\\\\").replace("`", "\\`") + "`"
    with tempfile.TemporaryDirectory() as folder:
        page = Path(folder) / "page.html"
        page.write_text(PAGE.format(library=library.resolve().as_uri(), text=literal))
        command = [*CHROMIUM.split(), f"--user-data-dir={folder}/profile", "--dump-dom", str(page)]
        done = subprocess.run(command, capture_output=True, text=True, check=True, timeout=120)
    match = re.search(r"<svg.*</svg>", done.stdout, re.DOTALL)
    if match is None:
        raise ValueError(f"cannot draw the diagram:\n{text}")
    drawing = match[0].replace('style="max-width', 'style="background: white; max-width', 1)
    return drawing.replace("<br>", "<br/>").replace("&nbsp;", " ")


def main() -> int:
    """Write the drawings."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("library", type=Path, help="mermaid.min.js")
    args = parser.parse_args()
    for page in sorted(DOCS.rglob("*.md")):
        for text in BLOCK.findall(page.read_text(encoding="utf-8")):
            path = DOCS / "pictures" / f"{page.stem}.svg"
            path.write_text(f"{fingerprint(text)}\n{draw(text, args.library)}\n", encoding="utf-8")
            sys.stdout.write(f"{path}\n")
    return 0


if __name__ == "__main__":
    sys.exit(main())
