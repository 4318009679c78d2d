"""``vvc-bench datasets``: make demonstration sets, fetch them, look at them, check them."""

import argparse
import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple, get_args

from vvc_bench.datasets.build import Engine, add_mirror_image, build_dataset, update_by_policies
from vvc_bench.datasets.catalogue import (
    CATALOGUE,
    LEARNED,
    PAPER_GRID,
    SAMPLE_GRID,
    GoalGrid,
    Mirrored,
    Specification,
    Updated,
    grid_flown,
    named_specification,
)
from vvc_bench.datasets.dataset import Dataset
from vvc_bench.datasets.local import checked_name, datasets_folder
from vvc_bench.datasets.progress import progress_line
from vvc_bench.datasets.publish import publish, publish_on_openml
from vvc_bench.datasets.sources import load_dataset
from vvc_bench.datasets.store import open_dataset
from vvc_bench.datasets.verify import Difference, difference, fly_again
from vvc_bench.goals import GOAL_COLUMNS
from vvc_bench.metrics import PUBLISHED
from vvc_bench.policies import Agent, open_agent
from vvc_bench.policies.trained import TRAINED

FAILED = 1
"""Exit code of a check that found something."""
_SHOWN = 5
"""Divergences and goals printed; ``--json`` has all."""
_GRIDS = {"paper": PAPER_GRID, "sample": SAMPLE_GRID}


class _Command(NamedTuple):
    summary: str
    add_options: Callable[[argparse.ArgumentParser], None]
    run: Callable[[argparse.Namespace], int]


def add_options(parser: argparse.ArgumentParser) -> None:
    """Say what can be chosen."""
    commands = parser.add_subparsers(dest="action", required=True, metavar="ACTION", title="actions")
    for name, known in _COMMANDS.items():
        action = commands.add_parser(
            name, help=known.summary, description=f"{known.summary.capitalize()}.", allow_abbrev=False
        )
        known.add_options(action)
        action.add_argument("--json", action="store_true", help="print one JSON document")


def run(options: argparse.Namespace) -> int:
    """Do it.

    Returns:
        0, or 1 where a check found something.

    Raises:
        ValueError: for an unknown name or an impossible choice.
        OSError: if a set cannot be read, fetched or written.
    """
    return _COMMANDS[options.action].run(options)


def _no_options(_parser: argparse.ArgumentParser) -> None:
    """Nothing to choose."""


def _one_set(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("set", help="a name, as pid-v0, or the path of a set's folder")
    parser.add_argument("--source", help="where it comes from if it is not here: build, openml, or a mirror's URL")


def _show(options: argparse.Namespace, document: Any, lines: list[str]) -> None:
    print(json.dumps(document, indent=2) if options.json else "\n".join(lines))


def _list(options: argparse.Namespace) -> int:
    rows = [
        {
            "name": name,
            "summary": specification.summary,
            "here": (datasets_folder() / name).is_dir(),
            "openml_id": specification.published.openml_id if specification.published else None,
        }
        for name, specification in CATALOGUE.items()
    ]
    width = max(map(len, CATALOGUE))
    lines = [f"{'*' if row['here'] else ' '} {row['name']:<{width}}  {row['summary']}" for row in rows]
    _show(options, rows, [*lines, f"* in {datasets_folder()}"])
    return 0


def _info(options: argparse.Namespace) -> int:
    dataset = load_dataset(options.set, source=options.source)
    document = {"folder": str(dataset.folder), "hash": dataset.hash, **dataset.manifest}
    files = dataset.manifest["files"].values()
    _show(
        options,
        document,
        [
            repr(dataset),
            f"folder       {dataset.folder} ({sum(file['bytes'] for file in files) / 1e6:.1f} MB)",
            f"hash         {dataset.hash}",
            *_table_1_lines(dataset),
        ],
    )
    return 0


def _table_1_lines(dataset: Dataset) -> list[str]:
    """The set's row of Table 1, and the paper's where there is one."""
    published = PUBLISHED.get(dataset.name)
    rows = {"here": dataset.manifest["metrics"]["table_1"]} | (dict(published.table_1) if published else {})
    lines = [
        f"{'':<12} {'trajectories':>12} {'coverage %':>10} {'length':>15} {'transitions':>11} "
        f"{'|Δv| m/s':>13} {'|Δμ| °':>13} {'|Δχ| °':>13}"
    ]
    for name, row in rows.items():
        lines.append(
            f"{name:<12} {_cell(row.get('trajectories')):>12} {_cell(row.get('coverage_percent'), 2):>10} "
            f"{_cell(row.get('length_steps'), 1):>15} {_cell(row.get('transitions')):>11} "
            f"{_cell(row.get('speed_error_mps'), 2):>13} {_cell(row.get('path_angle_error_deg'), 2):>13} "
            f"{_cell(row.get('azimuth_error_deg'), 2):>13}"
        )
    return lines


def _cell(value: Any, digits: int = 0) -> str:
    """A figure, or mean ± standard deviation."""
    if value is None:
        return "–"
    if isinstance(value, (int, float)):
        return f"{value:,.{digits}f}"
    mean, std = value.values() if isinstance(value, dict) else value
    return f"{mean:.{digits}f}" + ("" if math.isnan(std) else f"±{std:.{digits}f}")


def _build_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("set", help=f"one of {', '.join(CATALOGUE)}")
    parser.add_argument("--output", type=Path, metavar="FOLDER", help="where (default: among the local copies)")
    parser.add_argument("--threads", type=_positive, help="at most so many for a shard (default: all cores)")
    parser.add_argument("--shards", type=_positive, help="parts of the grid (default: one for every 4,096 goals)")
    parser.add_argument(
        "--engine", choices=get_args(Engine), default="local", help="what flies the shards (default: local)"
    )


def _positive(text: str) -> int:
    value = int(text)
    if value < 1:
        raise argparse.ArgumentTypeError(f"must be at least 1, got {value}")
    return value


def _build(options: argparse.Namespace) -> int:
    specification = named_specification(options.set)
    folder = options.output or datasets_folder() / specification.name
    with progress_line(f"building {specification.name}", "goals") as show:
        build_dataset(
            specification,
            folder,
            find_parent=load_dataset,
            threads=options.threads,
            shards=options.shards,
            engine=options.engine,
            progress=show,
        )
    return _show_made(options, folder)


def _show_made(options: argparse.Namespace, folder: Path) -> int:
    dataset = open_dataset(folder)
    document = {"folder": str(folder), "hash": dataset.hash, "table_1": dataset.manifest["metrics"]["table_1"]}
    _show(options, document, [f"{dataset!r} in {folder}", *_table_1_lines(dataset)])
    return 0


def _make_options(parser: argparse.ArgumentParser) -> None:
    """Of sets that are made from another one, and are of no catalogue."""
    _one_set(parser)
    parser.add_argument("--output", type=Path, required=True, metavar="FOLDER", help="where; its name is the set's")
    parser.add_argument(
        "--grid",
        choices=list(_GRIDS),
        help="all goals (default: paper, or what a set of the catalogue was flown to)",
    )
    parser.add_argument("--threads", type=_positive, help="at most so many (default: all cores)")


def _update_options(parser: argparse.ArgumentParser) -> None:
    _make_options(parser)
    parser.add_argument(
        "--policy",
        action="append",
        required=True,
        metavar="FILE",
        help="an ONNX file, or a trained policy of the package; may be given several times",
    )


def _named_parent(options: argparse.Namespace) -> tuple[str, Dataset]:
    """Name of a set that is to be made, and the set that it is made from."""
    name, parent = checked_name(options.output.name), load_dataset(options.set, source=options.source)
    if name == parent.name:
        raise ValueError(f"{name} is the set that it would be made from: give --output another name")
    return name, parent


def _grid(options: argparse.Namespace, parent: Dataset) -> GoalGrid:
    """All goals."""
    if options.grid is not None:
        return _GRIDS[options.grid]
    return grid_flown(parent.name) if parent.name in CATALOGUE else PAPER_GRID


def _file_hash(policy: str, agent: Agent) -> str:
    """What a set names a policy by."""
    sha256 = agent.describe()["sha256"]
    if sha256 is None:
        raise ValueError(
            f"{policy!r} has no file whose hash a set could name: give ONNX files, or some of {', '.join(TRAINED)}"
        )
    return sha256


def _update(options: argparse.Namespace) -> int:
    name, parent = _named_parent(options)
    agents = [open_agent(policy) for policy in options.policy]
    hashes = [_file_hash(policy, agent) for policy, agent in zip(options.policy, agents, strict=True)]
    recipe = Updated.by_files(_grid(options, parent), parent.name, hashes)
    specification = Specification(name, f"{parent.name} after policies flew the grid", LEARNED, recipe)
    with progress_line(f"flying {name}", "goals") as show:
        update_by_policies(specification, options.output, parent, agents, threads=options.threads, progress=show)
    return _show_made(options, options.output)


def _mirror(options: argparse.Namespace) -> int:
    name, parent = _named_parent(options)
    recipe, summary = Mirrored(parent.name, resimulate=False), f"{parent.name} and its mirror image"
    specification = Specification(name, summary, parent.scenario, recipe)
    add_mirror_image(specification, options.output, parent, _grid(options, parent).goals, threads=options.threads)
    return _show_made(options, options.output)


def _download(options: argparse.Namespace) -> int:
    dataset = load_dataset(options.set, source=options.source)
    _show(options, {"folder": str(dataset.folder), "hash": dataset.hash}, [f"{dataset!r} in {dataset.folder}"])
    return 0


def _verify_options(parser: argparse.ArgumentParser) -> None:
    _one_set(parser)
    parser.add_argument("--threads", type=_positive, help="at most so many (default: all cores)")


def _verify(options: argparse.Namespace) -> int:
    dataset = load_dataset(options.set, source=options.source)
    found = fly_again(dataset.check(), options.threads)
    document = found._asdict() | {"passed": found.passed, "hash": dataset.hash}
    document["divergences"] = [each._asdict() for each in found.divergences]
    lines = [
        f"{dataset.name}: files and tables are whole; {found.episodes:,} episodes flown again, "
        f"{found.transitions:,} transitions, {found.mirrored:,} mirrored back first",
        *(
            f"episode {each.episode} differs from step {each.step}: {each.column} {each.recorded:.9g} "
            f"is recorded, {each.flown:.9g} is flown"
            for each in found.divergences[:_SHOWN]
        ),
        "every value is what the aircraft flies"
        if found.passed
        else f"{len(found.divergences)} of {found.episodes} episodes differ",
    ]
    _show(options, document, lines)
    return 0 if found.passed else FAILED


def _diff_options(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("first", help="a name, or the path of a set's folder")
    parser.add_argument("second", help="the same of another")


def _diff(options: argparse.Namespace) -> int:
    found = difference(load_dataset(options.first).read(), load_dataset(options.second).read())
    goals = {name: getattr(found, name) for name in Difference._fields if name != "same"}
    document = {"goal_columns": GOAL_COLUMNS, "same": found.same} | {name: g.tolist() for name, g in goals.items()}
    lines = [f"from {options.first} to {options.second}: {found.same:,} goals with the same flight"]
    for name, those in goals.items():
        examples = "; ".join(", ".join(f"{value:g}" for value in goal) for goal in those[:_SHOWN].tolist())
        more = "; …" if len(those) > _SHOWN else ""
        lines.append(f"{name:<10} {len(those):>7,}{f'  ({examples}{more})' if examples else ''}")
    _show(options, document, lines)
    return 0


def _export_options(parser: argparse.ArgumentParser) -> None:
    _one_set(parser)
    parser.add_argument("--format", choices=list(_EXPORTS), required=True, help="what to write")
    parser.add_argument("--output", type=Path, required=True, help="file to write (minari: the name of its set)")


def _export(options: argparse.Namespace) -> int:
    dataset = load_dataset(options.set, source=options.source)
    _EXPORTS[options.format](dataset, options.output)
    _show(options, {"output": str(options.output)}, [f"wrote {options.output}"])
    return 0


def _export_csv(dataset: Dataset, path: Path) -> None:
    from vvc_bench.flight.files import write_whole

    frame = dataset.to_pandas()
    write_whole(
        path, lambda place: frame.to_csv(place, index=False), lambda place: _count_lines(place) == len(frame) + 1
    )


def _count_lines(path: Path) -> int:
    with path.open("rb") as file:
        return sum(1 for _ in file)


def _export_d4rl(dataset: Dataset, path: Path) -> None:
    import numpy as np

    from vvc_bench.datasets.convert.d4rl import to_d4rl
    from vvc_bench.flight.files import write_whole

    arrays = to_d4rl(dataset.read())

    def is_whole(place: Path) -> bool:
        with np.load(place) as read:
            return all(np.array_equal(read[name], values) for name, values in arrays.items())

    write_whole(path.with_suffix(".npz"), lambda place: np.savez_compressed(place, **arrays), is_whole)  # type: ignore[arg-type]


def _export_minari(dataset: Dataset, name: Path) -> None:
    from vvc_bench.datasets.convert.minari import to_minari

    to_minari(dataset.read(), name.as_posix())


_EXPORTS: dict[str, Callable[[Dataset, Path], None]] = {
    "csv": _export_csv,
    "npz": _export_d4rl,
    "minari": _export_minari,
}


def _plot_options(parser: argparse.ArgumentParser) -> None:
    _one_set(parser)
    parser.add_argument("--output", type=Path, metavar="FOLDER", help="where the pictures go (default: cards/NAME)")


def _plot(options: argparse.Namespace) -> int:
    from vvc_bench.datasets.card import write_dataset_card

    dataset = load_dataset(options.set, source=options.source)
    card = write_dataset_card(dataset, options.output or Path("cards") / dataset.name)
    _show(options, {"card": str(card)}, [f"wrote {card}, and its pictures beside it"])
    return 0


def _publish_options(parser: argparse.ArgumentParser) -> None:
    _one_set(parser)
    where = parser.add_mutually_exclusive_group(required=True)
    where.add_argument("--dir", type=Path, metavar="FOLDER", help="write files and data card into FOLDER/NAME")
    where.add_argument("--openml", action="store_true", help="upload under the API key of `openml configure apikey`")


def _publish(options: argparse.Namespace) -> int:
    dataset = load_dataset(options.set, source=options.source)
    if options.openml:
        number = publish_on_openml(dataset)
        _show(options, {"openml_id": number}, [f"{dataset.name} is openml-{number}"])
        return 0
    place = publish(dataset, options.dir)
    _show(options, {"folder": str(place)}, [f"wrote {place}; whoever serves {options.dir} runs a mirror"])
    return 0


_COMMANDS = {
    "list": _Command("list the known sets", _no_options, _list),
    "info": _Command("say what a set is, with its row of the paper's Table 1", _one_set, _info),
    "build": _Command("make a set from its specification", _build_options, _build),
    "update": _Command("fly policies to every goal, and keep what is new or shorter (IRPO)", _update_options, _update),
    "mirror": _Command("add a set's mirror image, left for right", _make_options, _mirror),
    "download": _Command("have a set on this machine, built or fetched", _one_set, _download),
    "verify": _Command("check every byte of a set, and fly every trajectory again", _verify_options, _verify),
    "diff": _Command("compare two sets goal by goal", _diff_options, _diff),
    "export": _Command("write a set in another format", _export_options, _export),
    "plot": _Command("write a set's data card: one page, and pictures", _plot_options, _plot),
    "publish": _Command("make a set ready for others: a mirror's folder, or OpenML", _publish_options, _publish),
}
