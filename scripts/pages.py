"""Parts of pages that commands write, each between `<!-- NAME -->` and `<!-- /NAME -->`."""

from collections.abc import Mapping


def filled(page: str, parts: Mapping[str, str]) -> str:
    """Return a page with its parts replaced, by name; raise ValueError if it has no place for one.

    A part ends with a newline.
    """
    for name, text in parts.items():
        begin, end = f"<!-- {name} -->\n", f"<!-- /{name} -->"
        if page.count(begin) != 1 or page.count(end) != 1:
            raise ValueError(f"the page needs one '{begin.strip()}' and one '{end}'")
        head, tail = page.split(begin, maxsplit=1)[0], page.split(end)[1]
        page = f"{head}{begin}\n{text}\n{end}{tail}"
    return page
