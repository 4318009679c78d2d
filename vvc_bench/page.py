"""Pages that need nothing else: their pieces, their style, and how figures are written for people.

A page carries its pictures within itself, runs no script, and reads on a phone as on a desk, in light and in dark.
"""

import base64
import html
import math
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from vvc_bench.flight.files import write_whole
from vvc_bench.metrics.statistics import Spread

UNKNOWN = "–"


class Shown(NamedTuple):
    """A picture as PNG files, for light and for dark pages."""

    name: str
    title: str
    caption: str
    light: bytes
    dark: bytes


def page(title: str, parts: Iterable[str]) -> str:
    """A whole page of ready-made parts; the title is text."""
    return _PAGE.replace("{title}", html.escape(title)).replace("{body}", "\n".join(filter(None, parts)))


def write_bytes(path: Path, content: bytes) -> None:
    """Make or replace a file in one move.

    Raises:
        OSError: if the folder cannot be made or written to.
    """

    def write(place: Path) -> None:
        place.write_bytes(content)

    write_whole(path, write, lambda place: place.read_bytes() == content)


# Pieces


def header(kind: str, title: str, lead: str, tiles: Iterable[tuple[str, str]]) -> str:
    """The top of a page: what it is, of what, a sentence, and the foremost figures with what they are."""
    items = "".join(f"<li><b>{value}</b><span>{text}</span></li>" for value, text in tiles)
    sentence = f"<p class=lead>{html.escape(lead)}</p>" if lead else ""
    heading = f"<p class=kind>{html.escape(kind)}</p><h1>{html.escape(title)}</h1>"
    return f"<header>{heading}{sentence}<ul class=tiles>{items}</ul></header>"


def section(title: str, content: str) -> str:
    """A titled part of a page; nothing for no content."""
    return f"<section><h2>{html.escape(title)}</h2>\n{content}</section>" if content else ""


def beside(*parts: str) -> str:
    """Parts in two columns, where the page is wide enough."""
    return "<div class=columns>" + "".join(f"<div>{part}</div>" for part in parts) + "</div>"


def figure(shown: Shown) -> str:
    """A picture with its title and caption."""
    light, dark = (base64.b64encode(content).decode() for content in (shown.light, shown.dark))
    width, height = (int.from_bytes(shown.light[at : at + 4]) for at in (16, 20))  # IHDR
    title, caption = html.escape(shown.title), html.escape(shown.caption)
    return (
        f"<figure><h3>{title}</h3><picture>"
        f'<source media="(prefers-color-scheme: dark)" srcset="data:image/png;base64,{dark}">'
        f'<img src="data:image/png;base64,{light}" width={width} height={height} alt="{title}. {caption}">'
        f"</picture><figcaption>{caption}</figcaption></figure>\n"
    )


def table(header: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """A table of ready-made cells; the first column names the rows, and a row of one cell what follows."""
    head = "".join(f"<th>{cell}</th>" for cell in header)
    body = "".join(
        f"<tr><th scope=row>{first}</th>" + "".join(f"<td>{cell}</td>" for cell in rest) + "</tr>"
        if rest
        else f"<tr><th colspan={len(header)}><b>{first}</b></th></tr>"
        for first, *rest in rows
    )
    return f"<div class=wide><table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table></div>\n"


def text_cell(content: str) -> str:
    """A cell that is set to the left."""
    return f"<span class=text>{html.escape(content)}</span>"


def hash_cell(digest: object) -> str:
    """A cell for a checksum, which may be broken into lines."""
    return f"<code class=text>{html.escape(str(digest))}</code>"


def note(content: str) -> str:
    """A small paragraph of ready-made text."""
    return f"<p class=note>{content}</p>"


# Numbers


def number(value: object, decimals: int = 0) -> str:
    """A figure for people: thousands set apart, a true minus sign, – for what is not known."""
    if isinstance(value, Spread):
        mean, std = number(value.mean, decimals), number(value.std, decimals)
        return mean if std == UNKNOWN else f"{mean} ± {std}"
    if not isinstance(value, int | float | np.number) or not math.isfinite(value):
        return UNKNOWN
    return f"{value:,.{decimals}f}".replace("-", "−")


def significant(value: float, digits: int = 3) -> str:
    """A figure to so many digits, – for what is not known."""
    if not math.isfinite(value):
        return UNKNOWN
    if value == 0.0:
        return "0"
    decimals = max(digits - 1 - math.floor(math.log10(abs(value))), 0)
    text = f"{value:,.{decimals}f}" if decimals <= 2 * digits else f"{value:.{digits - 1}e}"
    return text.replace("-", "−")


_PAGE = """<!doctype html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<meta name="color-scheme" content="light dark">
<title>{title}</title>
<style>
:root {
  --page: #f5f6f8; --sheet: #ffffff; --ink: #1c2230; --faint: #5d6675; --line: #e3e7ec; --accent: #0072b2;
  --code: #f0f2f5;
}
@media (prefers-color-scheme: dark) {
  :root {
    --page: #0e1116; --sheet: #171b22; --ink: #e8ebf0; --faint: #a3adbb; --line: #2c333d; --accent: #56b4e9;
    --code: #10141a;
  }
}
* { box-sizing: border-box; }
html { -webkit-text-size-adjust: 100%; }
body {
  margin: 0; background: var(--page); color: var(--ink);
  font: 1rem/1.55 system-ui, -apple-system, "Segoe UI", Roboto, "Noto Sans", "Liberation Sans", sans-serif;
}
main { max-width: 68rem; margin: 0 auto; padding: clamp(1rem, 4vw, 3rem) clamp(0.75rem, 3vw, 2rem); }
header { padding: 0 0.25rem 0.5rem; }
.kind { margin: 0; color: var(--accent); font-weight: 600; font-size: 0.85rem; letter-spacing: 0.02em; }
h1 { margin: 0.1rem 0 0.3rem; font-size: clamp(1.9rem, 6vw, 2.8rem); line-height: 1.15; overflow-wrap: anywhere; }
.lead { margin: 0 0 1.2rem; font-size: 1.1rem; color: var(--faint); }
.tiles {
  list-style: none; margin: 0; padding: 0; display: grid; gap: 0.6rem;
  grid-template-columns: repeat(auto-fit, minmax(9rem, 1fr));
}
.tiles li { background: var(--sheet); border: 1px solid var(--line); border-radius: 0.7rem; padding: 0.7rem 0.9rem; }
.tiles b { display: block; font-size: 1.3rem; line-height: 1.25; font-variant-numeric: tabular-nums; }
.tiles span { color: var(--faint); font-size: 0.85rem; }
section {
  background: var(--sheet); border: 1px solid var(--line); border-radius: 0.9rem;
  margin: 1rem 0; padding: clamp(1rem, 3vw, 1.6rem);
}
h2 { margin: 0 0 0.8rem; font-size: 1.25rem; line-height: 1.3; }
h3 { margin: 0 0 0.3rem; font-size: 0.95rem; }
p { margin: 0 0 0.8rem; max-width: 46rem; }
section > p:last-child, section > .wide:last-child { margin-bottom: 0; }
.columns { columns: 20rem 2; column-gap: 2rem; margin-bottom: -1.6rem; }
.columns + p, .columns + .wide { margin-top: 1.6rem; }
.columns > div { break-inside: avoid; padding-bottom: 1.6rem; }
figure { margin: 0; max-width: 32rem; }
figure img { display: block; width: 100%; height: auto; }
figcaption, .note { color: var(--faint); font-size: 0.85rem; line-height: 1.45; }
figcaption { margin-top: 0.4rem; }
.wide { overflow-x: auto; margin-bottom: 0.8rem; }
table {
  border-collapse: collapse; font-size: clamp(0.8rem, 0.7rem + 0.4vw, 0.9rem); font-variant-numeric: tabular-nums;
}
th, td {
  padding: 0.35rem clamp(0.5rem, 2vw, 1.2rem) 0.35rem 0; border-bottom: 1px solid var(--line);
  text-align: right; white-space: nowrap;
}
tr > :last-child { padding-right: 0; }
th:first-child, th:has(.text), td:has(.text) { text-align: left; }
td:has(code) { white-space: normal; overflow-wrap: anywhere; }
thead th { color: var(--faint); font-weight: 600; vertical-align: bottom; white-space: normal; }
thead:not(:has(th:not(:empty))) { display: none; }
tbody th { font-weight: 400; white-space: normal; }
th:first-child:not(:last-child) { position: sticky; left: 0; min-width: 6rem; background: var(--sheet); }
tbody b { font-weight: 600; color: var(--faint); }
pre {
  overflow-x: auto; margin: 0 0 0.9rem; padding: 0.7rem 0.9rem; background: var(--code); border-radius: 0.5rem;
  line-height: 1.45;
}
p code { white-space: nowrap; }
code { font-family: ui-monospace, "SF Mono", Menlo, Consolas, "Liberation Mono", monospace; font-size: 0.78rem; }
details { margin: 0 0 0.7rem; }
summary { cursor: pointer; color: var(--accent); padding: 0.2rem 0; }
@media print { body { background: none; } section, .tiles li { break-inside: avoid; } }
</style>
</head>
<body>
<main>
{body}
</main>
</body>
</html>
"""
