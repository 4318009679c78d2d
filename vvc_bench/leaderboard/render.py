"""The entries as tables in ``README.md`` and as a page, ``site/index.html``; the same entries give the same bytes."""

import html
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from vvc_bench.leaderboard.drawings import regions_drawing, success_drawing
from vvc_bench.leaderboard.entries import SITE
from vvc_bench.leaderboard.standings import Place, Standings, standings
from vvc_bench.leaderboard.submission import SUBMISSION, TrainingData
from vvc_bench.page import UNKNOWN, beside, header, note, number, page, section, write_bytes

README, PAGE = "README.md", f"{SITE}/index.html"

_TITLE = "vvc-bench leaderboard"
_HOW = (
    "Every number was made by flying the policy that lies in its folder; anybody can fly it again with "
    "vvc-bench leaderboard verify --all."
)
_RANKS = (
    "Rank: the ranks that paired tests on the same goals leave open (exact tests, Holm's correction, 5 % for all pairs "
    "of a table together). Entries whose ranks overlap are tied. Goals reached: with the 95 % Wilson interval. Length, "
    "in steps of 0.1 s, and errors over the last second: mean ± standard deviation of the flights that reached."
)
_ERRORS = {
    "speed_error_mps": "speed error, m/s",
    "path_angle_error_deg": "path angle error, °",
    "azimuth_error_deg": "azimuth error, °",
}
_MARKDOWN = re.compile(r"[\\`*_{}\[\]<>()#|~&!@:]")


def render(root: Path, *, check: bool = False) -> list[Path]:
    """Write the tables and the page.

    Args:
        root: folder of all entries.
        check: write nothing.

    Returns:
        The files that differ from what the entries say, now written unless only checked.

    Raises:
        ValueError: for an entry that cannot be read.
        OSError: if there is no such folder, or it cannot be written to.
    """
    known = standings(root)
    changed = []
    for name, text in {README: tables_text(known), PAGE: page_text(known)}.items():
        path, content = root / name, text.encode()
        if path.is_file() and path.read_bytes() == content:
            continue
        changed.append(path)
        if not check:
            write_bytes(path, content)
    return changed


# Markdown


def tables_text(known: Sequence[Standings]) -> str:
    """The tables as Markdown."""
    parts = [
        "# Leaderboard",
        "Written by `vvc-bench leaderboard render`: change entries, not this file. "
        f"[As a page]({PAGE}) with pictures and tables that can be sorted; "
        "[how to submit](../docs/leaderboard.md).",
        _HOW.replace("vvc-bench leaderboard verify --all", "`vvc-bench leaderboard verify --all`"),
        _RANKS,
    ]
    for each in known:
        parts += [f"## {each.protocol}", _sentence(each.about), _markdown_table(each.protocol, each.current)]
        parts += [f"- {_markdown_correction(place)}" for place in each.places if place.corrected_by]
    return "\n\n".join(parts) + "\n"


def _markdown_table(protocol: str, places: Sequence[Place]) -> str:
    rows = [
        "| rank | entry | goals reached | length | method | learned from | author |",
        "| --- | --- | ---: | ---: | --- | --- | --- |",
    ]
    for place in places:
        said = place.submission
        code = f" ([code]({said.code}))" if said.code else ""
        cells = [
            _rank(place),
            f"[{said.entry}]({protocol}/{said.entry}/{SUBMISSION})",
            _success(place),
            _spread(place.summary["length_steps"], 0),
            _markdown(said.method) + code,
            ", ".join(_markdown(data.name) for data in said.training_data) or UNKNOWN,
            _markdown(said.author),
        ]
        rows.append(f"| {' | '.join(cells)} |")
    return "\n".join(rows)


def _markdown_correction(place: Place) -> str:
    said = place.submission
    return (
        f"superseded: [{said.entry}]({said.protocol}/{said.entry}/{SUBMISSION}), {_success(place)}, by "
        f"{place.corrected_by}: {_markdown(place.reason)}"
    )


def _markdown(text: str) -> str:
    """Text of an author, which must not mark anything up."""
    return _MARKDOWN.sub(lambda found: f"&#{ord(found.group())};", text)


# Cells


def _sentence(text: str) -> str:
    return text[:1].upper() + text[1:].rstrip(".") + "."


def _rank(place: Place) -> str:
    if place.rank is None:
        return UNKNOWN
    low, high = place.rank
    return f"{low}" if low == high else f"{low}–{high}"


def _success(place: Place) -> str:
    success = place.summary["success"]
    return f"{100 * success['rate']:.1f} % ({100 * success['low']:.1f} to {100 * success['high']:.1f})"


def _spread(values: dict[str, float | None], decimals: int) -> str:
    mean, std = values["mean"], values["std"]
    return UNKNOWN if mean is None else f"{number(mean, decimals)} ± {number(std, decimals)}"


# The page


def page_text(known: Sequence[Standings]) -> str:
    """The page, which needs nothing else; without its script it shows the same tables."""
    entries = sum(len(each.current) for each in known)
    tiles = [(str(entries), "entries"), (str(len(known)), "protocols")]
    parts = [
        _STYLE,
        header("vvc-bench", "Leaderboard", _HOW, tiles),
        *(section(each.protocol, _protocol(each)) for each in known),
        section("How to read this", f"<p>{html.escape(_RANKS)}</p>" + note("Tables: a tap on a heading sorts by it.")),
        _SCRIPT,
    ]
    return page(_TITLE, parts)


def _protocol(known: Standings) -> str:
    drawings = [success_drawing(known.current), *regions_drawing(known.current)]
    corrections = "".join(f"<li>{_correction(place)}</li>" for place in known.places if place.corrected_by)
    return (
        f"<p>{html.escape(_sentence(known.about))}</p>"
        + _table(known.current)
        + (f"<ul class=note>{corrections}</ul>" if corrections else "")
        + beside(*filter(None, drawings))
    )


def _table(places: Sequence[Place]) -> str:
    heads = ["entry", "rank", "goals reached, %", "95 % interval", "length, steps", *_ERRORS.values()]
    texts = ["method", "learned from", "author", "submitted"]
    head = "".join(f"<th><button type=button>{name}</button></th>" for name in heads)
    head += "".join(f"<th><button type=button class=text>{name}</button></th>" for name in texts)
    rows = "".join(f"<tr>{''.join(_cells(place))}</tr>" for place in places)
    return f"<div class=wide><table class=sorted><thead><tr>{head}</tr></thead><tbody>{rows}</tbody></table></div>"


def _cells(place: Place) -> list[str]:
    said, summary = place.submission, place.summary
    success = summary["success"]
    folder = f"../{said.protocol}/{said.entry}"
    assert place.rank is not None
    code = f' (<a href="{html.escape(said.code)}">code</a>)' if said.code else ""
    return [
        f'<th scope=row><a href="{folder}/{SUBMISSION}">{said.entry}</a></th>',
        _cell(_rank(place), sum(place.rank)),
        _cell(f"{100 * success['rate']:.1f}", success["rate"]),
        _cell(f"{100 * success['low']:.1f} to {100 * success['high']:.1f}", success["low"]),
        _spread_cell(summary["length_steps"], 0),
        *(_spread_cell(summary[name], 2) for name in _ERRORS),
        _text_cell(html.escape(said.method) + code),
        _text_cell(", ".join(map(_training_data, said.training_data)) or UNKNOWN),
        _text_cell(html.escape(said.author)),
        _text_cell(said.submitted[:10]),
    ]


def _cell(text: str, value: object) -> str:
    return f"<td data-value={value}>{text}</td>"


def _spread_cell(values: dict[str, Any], decimals: int) -> str:
    mean = values["mean"]
    return _cell(_spread(values, decimals), "" if mean is None else mean)


def _text_cell(ready: str) -> str:
    return f"<td><span class=text>{ready}</span></td>"


def _training_data(data: TrainingData) -> str:
    title = f' title="{data.sha256}"' if data.sha256 else ""
    return f"<span{title}>{html.escape(data.name)}</span>"


def _correction(place: Place) -> str:
    said = place.submission
    return (
        f'Superseded: <a href="../{said.protocol}/{said.entry}/{SUBMISSION}">{said.entry}</a>, {_success(place)}, by '
        f"{place.corrected_by}: {html.escape(place.reason)}"
    )


_STYLE = """<style>
table.sorted { min-width: 100%; }
table.sorted td:has(.text) { white-space: normal; min-width: 9rem; }
table.sorted button {
  all: unset; cursor: pointer; color: inherit; font: inherit; text-align: inherit; border-radius: 0.2rem;
}
table.sorted button:focus-visible { outline: 2px solid var(--accent); }
table.sorted th[aria-sort] { color: var(--ink); }
table.sorted th[aria-sort=ascending] button::after { content: " ▲"; }
table.sorted th[aria-sort=descending] button::after { content: " ▼"; }
table.sorted tbody th { font-weight: 600; white-space: nowrap; }
table.sorted th:first-child { position: sticky; left: 0; background: var(--sheet); }
a { color: var(--accent); }
svg { display: block; width: 100%; height: auto; }
svg text { fill: var(--ink); font: 13px system-ui, sans-serif; }
svg .faint { fill: var(--faint); }
svg .grid { stroke: var(--line); }
.key { list-style: none; margin: 0.3rem 0 0; padding: 0; display: flex; flex-wrap: wrap; gap: 0.1rem 1rem; }
.key { font-size: 0.85rem; }
.key i { display: inline-block; width: 1rem; height: 0.2rem; margin-right: 0.4rem; vertical-align: middle; }
.s0 { --series: #0072b2; } .s1 { --series: #d55e00; } .s2 { --series: #009e73; } .s3 { --series: #cc79a7; }
.s4 { --series: #e69f00; } .s5 { --series: #56b4e9; }
@media (prefers-color-scheme: dark) { .s0 { --series: #4aa3df; } .s1 { --series: #f0803c; } }
.s0, .s1, .s2, .s3, .s4, .s5 { stroke: var(--series); }
.key i { background: var(--series); }
</style>"""

_SCRIPT = """<script>
for (const table of document.querySelectorAll("table.sorted")) {
  const body = table.tBodies[0];
  const heads = [...table.tHead.rows[0].cells];
  const key = (row, column) => {
    const cell = row.cells[column];
    return "value" in cell.dataset ? (cell.dataset.value === "" ? null : Number(cell.dataset.value)) : cell.textContent;
  };
  heads.forEach((head, column) => head.querySelector("button").addEventListener("click", () => {
    const order = head.getAttribute("aria-sort") === "ascending" ? "descending" : "ascending";
    heads.forEach((other) => other.removeAttribute("aria-sort"));
    head.setAttribute("aria-sort", order);
    const sign = order === "ascending" ? 1 : -1;
    const compare = (a, b) => {
      const [first, second] = [key(a, column), key(b, column)];
      if (first === null || second === null) return (first === null) - (second === null);
      return sign * (typeof first === "number" ? first - second : first.localeCompare(second));
    };
    body.append(...[...body.rows].sort(compare));
  }));
}
</script>"""
