"""The report: evaluations as one page that needs nothing else, with pictures.

The page carries its pictures within itself and reads on a phone as on a desk, in light and in dark. Takes the extra
``plot`` (matplotlib).
"""

import html
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from vvc_bench.datasets.pictures import draw_approaches, draw_paths
from vvc_bench.drawing import Picture, column_text, draw
from vvc_bench.evaluation import columns as names
from vvc_bench.evaluation.aggregate import SCORES, Aggregate, aggregate
from vvc_bench.evaluation.comparison import (
    SIGNIFICANT,
    Comparison,
    Pair,
    compare,
    protocol_goals,
    success_rate,
)
from vvc_bench.evaluation.evaluate import Evaluation
from vvc_bench.evaluation.methods import Method, protocol_hash, protocol_name
from vvc_bench.evaluation.pictures import ALONG, FLIGHTS, RANKS, Material, rank_text, success_map, win_map
from vvc_bench.evaluation.protocols import Protocol
from vvc_bench.metrics import Estimate, spread
from vvc_bench.page import (
    UNKNOWN,
    beside,
    figure,
    hash_cell,
    header,
    note,
    number,
    page,
    section,
    table,
    text_cell,
    write_bytes,
)
from vvc_bench.rollout import Episodes, Scenario

_SEED = 0
"""Of the bootstrap's resamples, so that the same evaluations give the same page."""

_SCORE_TEXT = {"success_percent": ("success, %", 2), "return": ("return", 1)}


def write_report(
    path: Path | str,
    methods: Sequence[Method],
    protocols: Mapping[str, Protocol],
    flights: Mapping[tuple[str, str], Episodes] | None = None,
    progress: Callable[[int, int], object] = lambda _done, _total: None,
) -> Path:
    """Write the report of evaluations.

    The file appears under its name only when it is whole. The same evaluations give the same page.

    Args:
        path: the page to write; the folder is made if need be.
        methods: what was evaluated, on one or more protocols.
        protocols: by name.
        flights: name of the protocol and label of the method → sample flights; the page says where there are none.
        progress: told how many protocols are done, and of how many.

    Returns:
        The page.

    Raises:
        ValueError: for no evaluations.
        ImportError: without matplotlib; says what to install.
        OSError: if the page cannot be written.
    """
    if not methods:
        raise ValueError("a report takes at least one evaluation")
    path = Path(path)
    path.parent.mkdir(parents=True, exist_ok=True)  # what cannot be written to is said before everything is drawn
    write_bytes(path, report_page(methods, protocols, flights or {}, progress).encode())
    return path


def report_page(
    methods: Sequence[Method],
    protocols: Mapping[str, Protocol],
    flights: Mapping[tuple[str, str], Episodes],
    progress: Callable[[int, int], object] = lambda _done, _total: None,
) -> str:
    """The page as text; see `write_report`."""
    by_protocol = _by_protocol(methods)
    title = " · ".join(by_protocol) if len(by_protocol) < 4 else f"{len(by_protocol)} protocols"
    parts = [_header(title, by_protocol)]
    for k, (name, those) in enumerate(by_protocol.items()):
        progress(k, len(by_protocol))
        heading = f"{name}: " if len(by_protocol) > 1 else ""
        found = compare(those, np.random.default_rng(_SEED)) if len(those) > 1 else None
        shown = {method.label: flights.get((name, method.label)) for method in those}
        parts += _protocol_sections(heading, those, protocols[name].scenario, found, shown)
    progress(len(by_protocol), len(by_protocol))
    parts += [section("Over runs", _runs(methods)), section("Where it is from", _provenance(methods))]
    return page(f"{title} – report", parts)


def _by_protocol(methods: Sequence[Method]) -> dict[str, list[Method]]:
    """Name of each protocol → the methods with their evaluations on it, in order of appearance."""
    found: dict[str, list[Method]] = {}
    for method in methods:
        for name in dict.fromkeys(protocol_name(evaluation) for evaluation in method.evaluations):
            those = tuple(evaluation for evaluation in method.evaluations if protocol_name(evaluation) == name)
            found.setdefault(name, []).append(Method(method.label, those))
    return found


def _header(title: str, by_protocol: Mapping[str, Sequence[Method]]) -> str:
    labels = list(dict.fromkeys(method.label for those in by_protocol.values() for method in those))
    every = [method for those in by_protocol.values() for method in those]
    flown = sum(len(evaluation.episodes) for method in every for evaluation in method.evaluations)
    if len(every) > 1:
        kinds = "policies" if all(len(method.evaluations) == 1 for method in every) else "methods"
        tiles = [(number(len(labels)), kinds)] if len(labels) > 1 else []
        tiles += [(number(flown), "flights")]
        tiles += [_best_tile(name, those) for name, those in by_protocol.items()]
        return header("vvc-bench report", title, _named(labels), tiles)
    rows = _rows(every[0])
    estimate = _success(every[0])
    tiles = [
        (number(100.0 * estimate.value, 1) + " %", "of the goals reached"),
        (f"{_ends(estimate)} %", "95 % Wilson interval"),
        (number(flown), "flights"),
        (number(rows[names.RETURN].mean(), 1), "mean return"),
    ]
    return header("vvc-bench report", labels[0], f"{title}.", tiles)


def _named(labels: Sequence[str]) -> str:
    few = labels if len(labels) <= 6 else [*labels[:5], f"{len(labels) - 5} more"]
    return f"{', '.join(few[:-1])} and {few[-1]}." if len(few) > 1 else f"{few[0]}."


def _best_tile(name: str, methods: Sequence[Method]) -> tuple[str, str]:
    best = max(methods, key=lambda method: _success(method).value)
    text = f"on {name}" if len(methods) == 1 else f"best on {name}: {best.label}"
    return number(100.0 * _success(best).value, 1) + " %", html.escape(text)


def _rows(method: Method) -> pd.DataFrame:
    """All flights of a method on one protocol."""
    return pd.concat([evaluation.episodes for evaluation in method.evaluations], ignore_index=True)


def _success(method: Method) -> Estimate:
    shares = _rows(method).groupby(names.GOAL)[names.SUCCESS].mean()
    return success_rate(shares.to_numpy(dtype=np.float64))


def _ends(estimate: Estimate) -> str:
    """An interval in percent."""
    return f"{number(100.0 * estimate.low, 1)}–{number(100.0 * estimate.high, 1)}"


# One protocol


def _protocol_sections(
    heading: str,
    methods: Sequence[Method],
    scenario: Scenario,
    comparison: Comparison | None,
    flights: Mapping[str, Episodes | None],
) -> list[str]:
    material = Material(
        protocol_goals(methods[0].evaluations[0]),
        {method.label: _rows(method) for method in methods},
        scenario.task,
        scenario.settings.time_step,
        comparison,
    )
    common = [figure(draw(picture, material)) for picture in FLIGHTS]
    where = (*(success_map(name) for name in material.flights), ALONG) if material.has_spread else ()
    maps = [figure(draw(picture, material)) for picture in where]
    return [
        section(f"{heading}Results", _results(methods, material)),
        section(f"{heading}Who is better", _better(comparison, material) if comparison else ""),
        section(f"{heading}Flights", beside(*common)),
        section(f"{heading}Where goals are reached", beside(*maps) if maps else ""),
        section(f"{heading}Where each wins", _wins(comparison, material) if comparison and maps else ""),
        section(f"{heading}Sample flights", _samples(flights)),
    ]


def _results(methods: Sequence[Method], material: Material) -> str:
    """A line for each method: success, time, errors, return."""
    ranks = {found.label: found.rank for found in material.comparison.contenders} if material.comparison else {}
    ordered = sorted(methods, key=lambda method: -_success(method).value)
    known = any(rows[names.TIME_RATIO].notna().any() for rows in material.flights.values())
    head = [
        "",
        *(["rank"] if ranks else []),
        "reached, %",
        "95 % interval",
        "time to reach, s",
        *(["time ratio"] if known else []),
        *map(column_text, names.ERRORS),
        "return",
    ]
    rows = [
        [
            html.escape(method.label),
            *([rank_text(*ranks[method.label])] if ranks else []),
            *_result_cells(method, material.time_step_s, known),
        ]
        for method in ordered
    ]
    remark = (
        "Mean ± standard deviation over the flights that reached; return: over all flights. Errors: mean over the last "
        "second, direction: at the end. Intervals: Wilson's, of one trial for each goal."
    )
    if known:
        remark += " Time ratio: length over that of the shortest known flight to the same goal."
    return table(head, rows) + note(remark)


def _result_cells(method: Method, time_step_s: float, with_ratio: bool) -> list[str]:
    rows, estimate = _rows(method), _success(method)
    reached = rows[rows[names.SUCCESS]]
    ratio = [number(spread(reached[names.TIME_RATIO]), 2)] if with_ratio else []
    return [
        number(100.0 * estimate.value, 2),
        _ends(estimate),
        number(spread(reached[names.LENGTH] * time_step_s), 1),
        *ratio,
        *(number(spread(reached[column]), 2) for column in names.ERRORS),
        number(spread(rows[names.RETURN]), 1),
    ]


def _better(comparison: Comparison, material: Material) -> str:
    pairs = [
        [
            html.escape(f"{pair.first} – {pair.second}"),
            _signed(pair.difference.value),
            f"{_signed(pair.difference.low)} to {_signed(pair.difference.high)}",
            number(pair.first_only),
            number(pair.second_only),
            p_text(pair.p_value),
            p_text(pair.adjusted_p_value),
            text_cell(pair.better or "open"),
        ]
        for pair in comparison.pairs
    ]
    head = ["", "difference, %", "95 % interval", "first wins", "second wins", "p", "p (Holm)", text_cell("better")]
    remark = (
        "First and second wins: goals that one reaches more often than the other. p: McNemar's exact test, or where "
        "each goal is flown several times the exact sign-flip test of the differences; then corrected for the number "
        f"of pairs. A difference counts where that is below {SIGNIFICANT:g}; the ranks are those that such differences "
        "leave open, all of them right at once with 95 % confidence. All of it is about these policies; of the "
        "methods that they are runs of, the spread over runs tells more."
    )
    return beside(figure(draw(RANKS, material))) + table(head, pairs) + note(remark)


def _signed(share: float) -> str:
    text = number(100.0 * share, 2)
    return f"+{text}" if share > 0.0 else text


def p_text(value: float) -> str:
    """A p-value to two digits."""
    return "&lt; 0.0001" if value < 1e-4 else f"{value:.2g}"


def _wins(comparison: Comparison, material: Material) -> str:
    best = comparison.contenders[0].label
    pairs: list[Pair] = [pair for pair in comparison.pairs if best in (pair.first, pair.second)]
    return beside(*(figure(draw(win_map(pair), material)) for pair in pairs))


# Sample flights


def _samples(flights: Mapping[str, Episodes | None]) -> str:
    """Some flights of each method, flown again."""
    parts = []
    for label, episodes in flights.items():
        name = html.escape(label)
        if episodes is None:
            parts.append(f"<p><b>{name}</b>: not shown; its policy is not at hand (<code>--policy FILE</code>).</p>")
        else:
            parts.append(
                f"<h3>{name}</h3>" + beside(*(figure(draw(each, episodes)) for each in _flight_pictures(episodes)))
            )
    return "".join(parts)


def _flight_pictures(episodes: Episodes) -> tuple[Picture[Episodes], ...]:
    count, reached = len(episodes), int(episodes.reached.sum())
    return (
        Picture(
            "paths",
            "In space",
            f"{count} flights drawn at random, {reached} of which reach; the longest are left out. Altitude is drawn "
            "enlarged.",
            draw_paths,
        ),
        Picture(
            "approaches",
            "How they come to their goals",
            "The same flights: what is still missing, over time. Band: what counts as reached.",
            draw_approaches,
        ),
    )


# Over runs


def _runs(methods: Sequence[Method]) -> str:
    """Scores over the runs of each method; nothing where no method has more than one."""
    generator = np.random.default_rng(_SEED)
    found = {
        method.label: {score: aggregate(method.evaluations, score, generator) for score in SCORES} for method in methods
    }
    if not any(max(part.runs.values()) > 1 for scores in found.values() for part in scores.values()):
        return ""
    head = [
        "",
        "runs",
        *(f"{_SCORE_TEXT[score][0]}: {what}" for score in SCORES for what in ("mean ± std", "IQM", "95 %")),
    ]
    rows = [
        [
            html.escape(label),
            _run_text(scores["success_percent"]),
            *(c for s in SCORES for c in _score_cells(s, scores[s])),
        ]
        for label, scores in found.items()
    ]
    remark = (
        "A run is an evaluated policy; where a method has one policy for each protocol, a seed of its flights. IQM: "
        "the mean of the middle half of all runs on all protocols, with a bootstrap interval stratified by protocol."
    )
    return table(head, rows) + note(remark)


def _run_text(found: Aggregate) -> str:
    counts = " + ".join(number(count) for count in found.runs.values())
    return counts if set(found.runs.values()) == {1} else f"{counts} {found.over}"


def _score_cells(score: str, found: Aggregate) -> list[str]:
    decimals = _SCORE_TEXT[score][1]
    value, low, high = (number(part, decimals) for part in found.interquartile_mean)
    if set(found.runs.values()) == {1}:
        return [number(found.mean_std.mean, decimals), UNKNOWN, UNKNOWN]
    return [number(found.mean_std, decimals), value, UNKNOWN if low == UNKNOWN else f"{low} to {high}"]


# Where it is from


def _provenance(methods: Sequence[Method]) -> str:
    every = [(method.label, evaluation) for method in methods for evaluation in method.evaluations]
    rows = [[html.escape(label), *_origin(evaluation)] for label, evaluation in every]
    digests = [(f"protocol {protocol_name(evaluation)}", protocol_hash(evaluation)) for _, evaluation in every]
    digests += [(f"policy of {label}", evaluation.summary["policy"].get("sha256")) for label, evaluation in every]
    names = [[html.escape(name), hash_cell(digest)] for name, digest in dict.fromkeys(digests) if digest]
    head = ["", *map(text_cell, ("protocol", "policy", "seeds", "vvc-bench"))]
    return table(head, rows) + table(["", ""], names)


def _origin(evaluation: Evaluation) -> list[str]:
    summary: Mapping[str, Any] = evaluation.summary
    policy = summary["policy"]
    return [
        text_cell(protocol_name(evaluation)),
        text_cell(f"{policy['name']} ({policy['kind']})"),
        text_cell(", ".join(map(str, summary["seeds"]))),
        text_cell(str(summary["versions"]["vvc_bench"])),
    ]
