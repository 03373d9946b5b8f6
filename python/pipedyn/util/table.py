# SPDX-License-Identifier: MIT
"""Rows of cells as text for a terminal and as HTML for a notebook."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from pipedyn.util.later import html


@dataclass(frozen=True)
class Table:
    """A table with a title, and notes below; `numbers` aligns all columns but the first right."""

    title: str
    headings: tuple[str, ...]
    rows: Sequence[tuple[str, ...]]
    numbers: bool = False
    notes: Sequence[str] = ()

    def text(self) -> str:
        """The table as lines of text for a terminal."""
        widths = [max(map(len, column)) for column in zip(self.headings, *self.rows, strict=True)]
        set_flush = str.rjust if self.numbers else str.ljust
        lines = []
        for cells in (self.headings, *self.rows):
            others = map(set_flush, cells[1:], widths[1:])
            lines.append("  ".join([cells[0].ljust(widths[0]), *others]).rstrip())
        return "\n".join([self.title, *lines, *self.notes])

    def html(self) -> str:
        """The table as HTML for a notebook."""
        title = html.escape(self.title).replace("\n", "<br>")
        body = "".join(_line(cells, "td") for cells in self.rows)
        notes = "".join(f"<p>{html.escape(note)}</p>" for note in self.notes)
        return (
            f"<table><caption>{title}</caption><thead>{_line(self.headings, 'th')}</thead>"
            f"<tbody>{body}</tbody></table>{notes}"
        )


def _line(cells: tuple[str, ...], tag: str) -> str:
    return f"<tr>{''.join(f'<{tag}>{html.escape(cell)}</{tag}>' for cell in cells)}</tr>"
