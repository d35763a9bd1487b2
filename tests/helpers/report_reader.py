"""Reads a report as a browser would, strictly; and a document's screen."""

from html.parser import HTMLParser

from rich.console import Console

from barnax.cli.session import as_flags
from barnax.reporting.terminal import to_terminal

EMPTY = {"meta", "link", "img", "br"}
REFERENCES = {"src", "href", "srcset", "data", "action", "poster", "background"}


class ReportReader(HTMLParser):
    """The tags, references and visible text of a page. Raises where a tag is closed out of turn."""

    def __init__(self, page: str):
        super().__init__(convert_charrefs=True)
        self.open: list[str] = []
        self.tags: list[tuple[str, dict[str, str | None]]] = []
        self.text = ""
        self.feed(page)
        self.close()

    def handle_starttag(self, tag, attrs):
        if tag == "wbr":
            # A place where a long name may break, in the middle of its text.
            self.text = self.text.removesuffix("\n")
            return
        self.tags.append((tag, dict(attrs)))
        if tag not in EMPTY:
            self.open.append(tag)

    def handle_startendtag(self, tag, attrs):
        self.tags.append((tag, dict(attrs)))

    def handle_endtag(self, tag):
        if not self.open or self.open.pop() != tag:
            raise ValueError(f"</{tag}> closes nothing at {self.getpos()}")

    def handle_data(self, data):
        if not {"style", "script"} & set(self.open):
            self.text += f"{data}\n"

    @property
    def references(self) -> list[str]:
        """Everything that a browser would fetch or follow."""
        return [
            value or ""
            for _, attributes in self.tags
            for name, value in attributes.items()
            if name in REFERENCES
        ]

    def count(self, tag: str) -> int:
        return sum(each == tag for each, _ in self.tags)


def screen_of(document, width: int = 1000) -> str:
    """A document's blocks as a terminal that wide shows them, options named as on it."""
    console = Console(width=width, color_system=None)
    with console.capture() as shown:
        console.print(to_terminal(document.with_option_names(as_flags)))
    return shown.get()
