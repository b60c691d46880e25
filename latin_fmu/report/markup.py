"""HTML of plain texts, tables and figures: everything is escaped here, and nothing is loaded from elsewhere."""

from __future__ import annotations

import base64
import html
import io
import re
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Final, NewType

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Html = NewType("Html", str)
"""Text that is HTML already."""
_DOTS: Final = 130  # per inch of a figure


def escaped(text: object) -> Html:
    """A text as HTML."""
    return Html(html.escape(str(text)))


def paragraph(text: str, look: str = "") -> Html:
    """A paragraph of plain text; ``look`` : class of the style sheet."""
    return Html(f"<p{_class(look)}>{escaped(text)}</p>")


def heading(text: str) -> Html:
    """A heading inside a section."""
    return Html(f"<h3>{escaped(text)}</h3>")


def items(texts: Iterable[str], look: str = "") -> Html:
    """A list of plain texts; nothing where there are none."""
    found = "".join(f"<li>{escaped(text)}</li>" for text in texts)
    return Html(f"<ul{_class(look)}>{found}</ul>" if found else "")


def table(rows: Sequence[Sequence[str]], heads: int = 1, bad: Callable[[Sequence[str]], bool] | None = None) -> Html:
    """A table of plain texts; nothing where there is no row below its head.

    Parameters
    ----------
    rows : the first ``heads`` of them are the head. bad : whether a row is shown in red.
    """
    if len(rows) <= heads:
        return Html("")
    numeric = [all(_NUMBER.match(cell) for cell in column) for column in zip(*rows[heads:], strict=True)]
    head = "".join(f"<tr>{_cells(row, 'th', numeric)}</tr>" for row in rows[:heads])
    lines = (_line(_cells(row, "td", numeric), bad is not None and bad(row)) for row in rows[heads:])
    wide = _class("wide" if len(rows[0]) > _MOST_COLUMNS else "")
    return Html(f"<table{wide}><thead>{head}</thead><tbody>{''.join(lines)}</tbody></table>")


_MOST_COLUMNS: Final = 7  # in the size of the text; more have smaller letters


def named_texts(rows: Iterable[Sequence[str]], bad: Callable[[Sequence[str]], bool] | None = None) -> Html:
    """Names with a text each, as a table without head."""
    lines = [
        _line(f"<th>{escaped(row[0])}</th><td>{escaped(row[1])}</td>", bad is not None and bad(row)) for row in rows
    ]
    return Html(f'<table class="named"><tbody>{"".join(lines)}</tbody></table>' if lines else "")


def picture(figure: Figure, caption: str) -> Html:
    """A figure inside the page, as PNG."""
    content = io.BytesIO()
    figure.savefig(content, format="png", dpi=_DOTS)
    data, words = base64.b64encode(content.getvalue()).decode("ascii"), escaped(caption)
    image = f'<img alt="{words}" src="data:image/png;base64,{data}">'
    return Html(f"<figure>{image}<figcaption>{words}</figcaption></figure>")


def _line(cells: str, bad: bool) -> str:
    return f"<tr{_class('bad' if bad else '')}>{cells}</tr>"


_NUMBER: Final = re.compile(r"$|-$|\(?[-+<>]*\s?\d|max \d")
"""Begin of what is aligned to the right."""


def _cells(row: Sequence[str], tag: str, numeric: Sequence[bool]) -> str:
    """Cells of a row; a number stays with its unit."""
    texts = (escaped(re.sub(r"(?<=\d) (?=[^\W\dx]|%)", "\N{NO-BREAK SPACE}", cell)) for cell in row)
    pairs = zip(texts, numeric, strict=True)
    return "".join(f"<{tag}{_class('number' if right else '')}>{text}</{tag}>" for text, right in pairs)


def _class(look: str) -> str:
    return f' class="{look}"' if look else ""


@dataclass
class PageSection:
    """A section of a page: its title, and its parts in their order; empty parts are left out."""

    title: str
    parts: list[Html] = field(default_factory=list)

    def add(self, *parts: Html) -> None:
        """Put parts at the end; empty ones are left out."""
        self.parts += [part for part in parts if part]

    def html(self, number: int) -> str:
        """The section with its number; its text says so where it has no parts."""
        name = f"section-{number}"
        inner = "\n".join(self.parts) or paragraph("The run has none.")
        return f'<section id="{name}">\n<h2>{number} {escaped(self.title)}</h2>\n{inner}\n</section>'


def whole_page(title: str, sections: Sequence[PageSection]) -> str:
    """The page, with its style inside."""
    style = Path(__file__).with_name("report.css").read_text(encoding="utf-8")
    body = "\n".join(section.html(i) for i, section in enumerate(sections, 1))
    head = '<meta charset="utf-8">\n<meta name="viewport" content="width=device-width, initial-scale=1">\n'
    head += f"<title>{escaped(title)}</title>\n<style>\n{style}</style>"
    content = f"<h1>{escaped(title)}</h1>\n{body}"
    return f'<!DOCTYPE html>\n<html lang="en">\n<head>\n{head}\n</head>\n<body>\n{content}\n</body>\n</html>\n'
