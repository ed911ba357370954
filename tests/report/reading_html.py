"""Reading an HTML page back without a browser."""

import re
from html import unescape
from html.parser import HTMLParser
from pathlib import Path


class Cells(HTMLParser):
    """Text of every table cell of a document, row by row."""

    def __init__(self):
        super().__init__()
        self.rows: list[list[str]] = []
        self.inside = False

    def handle_starttag(self, tag, attrs):
        if tag == "tr":
            self.rows.append([])
        elif tag in ("td", "th"):
            self.rows[-1].append("")
            self.inside = True

    def handle_endtag(self, tag):
        if tag in ("td", "th"):
            self.rows[-1][-1] = self.rows[-1][-1].strip()
            self.inside = False

    def handle_data(self, data):
        if self.inside:
            self.rows[-1][-1] += data


def words_of(page: Path) -> str:
    """The page's words in one line, without its figures."""
    text = page.read_text(encoding="utf-8")
    text = re.sub(r"<(svg|style).*?</\1>", " ", text, flags=re.S)
    text = re.sub(r"</?span[^>]*>", "", text)  # within a word
    return " ".join(unescape(re.sub(r"<[^>]+>", " ", text)).split())
