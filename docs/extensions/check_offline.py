"""Built pages fetch nothing from elsewhere: no script, style, picture, font or frame with an address of another host.

    python docs/extensions/check_offline.py FOLDER

Links that a reader may follow are no fetches. Ends with 1 and the list of what would be fetched.
"""

import re
import sys
from html.parser import HTMLParser
from pathlib import Path

FETCHED = {"script": "src", "img": "src", "iframe": "src", "source": "src", "link": "href", "use": "href"}
NOT_FETCHED = {"next", "prev", "search", "index", "canonical", "genindex"}  # relations of <link> that load nothing
REMOTE = re.compile(r"^(?:https?:)?//")
IN_STYLE = re.compile(r"(?:url\(|@import\s+)[\"']?((?:https?:)?//[^\"')\s]+)")


class Fetches(HTMLParser):
    """Addresses of other hosts that a page would load."""

    def __init__(self) -> None:
        super().__init__()
        self.remote: list[str] = []

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        given = dict(attrs)
        if tag == "link" and given.get("rel") in NOT_FETCHED:
            return
        address = given.get(FETCHED.get(tag, ""))
        if address and REMOTE.match(address):
            self.remote.append(address)


def remote_fetches(folder: Path) -> list[str]:
    """`FILE: ADDRESS` of every fetch from elsewhere in the pages and style sheets of a folder."""
    found = []
    for page in sorted(folder.rglob("*.html")):
        parser = Fetches()
        parser.feed(page.read_text(encoding="utf-8"))
        found += [f"{page.relative_to(folder)}: {address}" for address in parser.remote]
    for style in sorted(folder.rglob("*.css")):
        text = style.read_text(encoding="utf-8")
        found += [f"{style.relative_to(folder)}: {address}" for address in IN_STYLE.findall(text)]
    return found


if __name__ == "__main__":
    pages = Path(sys.argv[1])
    if not any(pages.glob("*.html")):
        sys.exit(f"there are no pages in {pages}")
    if wrong := remote_fetches(pages):
        sys.exit("\n".join(wrong))
