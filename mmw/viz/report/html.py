"""Write parts of HTML: escaped text, tables, tiles, figures, and formatted numbers."""

from collections.abc import Container, Iterable, Sequence
from html import escape


def text(value: object) -> str:
    """Return a value as text that holds no markup."""
    return escape(str(value), quote=True)


def count(value: int) -> str:
    """Return a number with separators: 12,345."""
    return f"{value:,}"


def size(value: int) -> str:
    """Return bytes with a decimal unit: 12.3 MB."""
    for limit, unit in ((1e9, "GB"), (1e6, "MB"), (1e3, "kB")):
        if value >= limit:
            return f"{value / limit:,.1f} {unit}"
    return f"{value} B"


def plural(number: int, word: str, words: str = "") -> str:
    """Return a number with its word: 1 frame, 2 frames."""
    return f"{number:,} {word if number == 1 else words or word + 's'}"


def table(
    head: Sequence[str], rows: Iterable[Sequence[object]], *, numbers: Container[int] = (), caption: str = ""
) -> str:
    """Return a table that scrolls sideways if it is too wide; `numbers` are the columns of numbers. Text is escaped."""

    def cells(tag: str, values: Sequence[object]) -> str:
        return "".join(
            f"<{tag}{' class=n' if i in numbers else ''}>{text(value)}</{tag}>" for i, value in enumerate(values)
        )

    body = "".join(f"<tr>{cells('td', row)}</tr>" for row in rows)
    note = f"<caption>{text(caption)}</caption>" if caption else ""
    top = f"<thead><tr>{cells('th', head)}</tr></thead>" if any(head) else ""
    return f"<div class=scroll tabindex=0><table>{note}{top}<tbody>{body}</tbody></table></div>"


def tiles(facts: Iterable[tuple[str, str]]) -> str:
    """Return boxes with a value and what it is."""
    boxes = "".join(f"<div><dt>{text(name)}</dt><dd>{text(value)}</dd></div>" for name, value in facts)
    return f"<dl class=tiles>{boxes}</dl>"


def section(identity: str, title: str, *parts: str, level: int = 2) -> str:
    """Return a section with a heading that can be linked to; `parts` are HTML."""
    return f'<section id="{text(identity)}"><h{level}>{text(title)}</h{level}>{"".join(parts)}</section>'


def paragraph(words: str, kind: str = "") -> str:
    """Return a paragraph; the text is escaped. Kinds: note, warning."""
    mark = f" class={kind}" if kind else ""
    return f"<p{mark}>{text(words)}</p>"


def card(title: str, body: str, note: str = "") -> str:
    """Return a chart in a box with a title and a note; `body` is HTML."""
    below = f"<figcaption>{text(note)}</figcaption>" if note else ""
    return f"<figure class=card><h4>{text(title)}</h4>{body}{below}</figure>"


def legend(entries: Iterable[tuple[str, str]]) -> str:
    """Return a legend of entries such as `("line s0", "sunny")`: class of the sample and name."""
    found = "".join(f'<span><i class="{text(kind)}"></i>{text(name)}</span>' for kind, name in entries)
    return f"<div class=legend>{found}</div>"


def details(summary: str, body: str) -> str:
    """Return a part that opens at a click; `body` is HTML."""
    return f"<details><summary>{text(summary)}</summary>{body}</details>"
