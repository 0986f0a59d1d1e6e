"""Parts of pages that commands write, each between `<!-- NAME -->` and `<!-- /NAME -->`."""

import re
from collections.abc import Mapping


def filled(page: str, parts: Mapping[str, str]) -> str:
    """Return a page with its parts replaced, by name; raise ValueError if it has no place for one.

    A part ends with a newline.
    """
    for name, text in parts.items():
        place = re.compile(rf"(<!-- {name} -->\n).*?(<!-- /{name} -->)", re.DOTALL)
        page, count = place.subn(lambda match, text=text: f"{match[1]}\n{text}\n{match[2]}", page)
        if count != 1:
            raise ValueError(f"the page needs one `<!-- {name} -->` … `<!-- /{name} -->`")
    return page
