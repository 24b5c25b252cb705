# SPDX-License-Identifier: LGPL-3.0-or-later
"""Check the links and pictures of the built pages: files and places within pages.

``python3 docs/check_links.py docs/_build/html``; external addresses are for ``make docs-links``.
"""

from __future__ import annotations

import sys
from functools import cache
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit


class Page(HTMLParser):
    """Links of a page, and the places in it that can be linked to."""

    def __init__(self, text: str):
        super().__init__()
        self.targets: list[str] = []
        self.places: set[str] = set()
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        """Keep the addresses and names of a tag."""
        for name, value in attrs:
            if name in ("href", "src") and value:
                self.targets.append(value)
            elif name in ("id", "name") and value:
                self.places.add(value)


@cache
def page(file: Path) -> Page:
    """A page, read once."""
    return Page(file.read_text())


def broken(folder: Path) -> list[str]:
    """Links that lead nowhere, each with its page.

    Args:
        folder: of the built pages.
    """
    found = []
    pages = (f for f in folder.rglob("*.html") if "_static" not in f.parts)
    for file in sorted(pages):
        for target in dict.fromkeys(page(file).targets):
            address = urlsplit(target)
            if address.scheme or address.netloc:
                continue
            path = unquote(address.path)
            there = file if not path else (file.parent / path).resolve()
            if there.is_dir():
                there /= "index.html"
            place = unquote(address.fragment)
            if not there.exists():
                found.append(f"{file.relative_to(folder)}: {target} is not there")
            elif place and there.suffix == ".html" and place not in page(there).places:
                found.append(f"{file.relative_to(folder)}: {target} has no such place")
    return found


def main() -> int:
    """Print broken links; 1 if there are any."""
    folder = Path(sys.argv[1]).resolve()
    found = broken(folder)
    print("\n".join(found) or f"{len(list(folder.rglob('*.html')))} pages, no broken link")
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
