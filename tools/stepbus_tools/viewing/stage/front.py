"""viser's page as ours: its title and mark, its colours, its keys, and a name for each control."""

import gzip
import html
import re
from functools import cache
from importlib.resources import files
from typing import Any
from urllib.parse import quote

from stepbus_tools.look import MARK, style_sheet
from stepbus_tools.viewing.access import Process

_TITLE = "<title>Viser</title>"
_ICON = re.compile(r'<link\s+rel="icon".*?/>', re.DOTALL)
_PAGES = ("/", "/index.html")


def branded(page: str, title: str) -> str:
    """Return a page of viser's client with our title and mark."""
    icon = f'<link rel="icon" type="image/svg+xml" href="data:image/svg+xml,{quote(MARK)}"/>'
    page = _ICON.sub(lambda _: icon, page, count=1)
    return page.replace(_TITLE, f"<title>{html.escape(title)} · stepbus</title>", 1)


def with_front(process: Process, title: str) -> Process:
    """Return what answers as viser's server does, but with our title, style and script."""

    @cache
    def front(body: bytes, is_packed: bool) -> bytes:
        page = branded((gzip.decompress(body) if is_packed else body).decode(), title)
        ours = f"<style>{style_sheet()}{_asset('front.css')}</style>"
        ours += f"<script>{_asset('front.js')}</script>"
        # Ahead of viser's own script, which reads what ours has set.
        data = page.replace("</title>", f"</title>{ours}", 1).encode()
        return gzip.compress(data) if is_packed else data

    def process_request(connection: Any, request: Any) -> Any:
        response = process(connection, request)
        if response is not None and request.path.partition("?")[0] in _PAGES:
            is_packed = response.headers.get("Content-Encoding") == "gzip"
            response.body = front(response.body, is_packed)
            del response.headers["Content-Length"]
            response.headers["Content-Length"] = str(len(response.body))
        return response

    return process_request


def _asset(name: str) -> str:
    return (files(__package__ or "") / "assets" / name).read_text("utf-8")
