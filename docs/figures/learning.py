"""Figures and tables of docs/learning.md, from what results/ holds, and the sets of IRPO.

python docs/figures/learning.py    # a minute; some more where the sets are not here yet
"""

import json
from pathlib import Path
from typing import Any

import numpy as np
from figure_tools import COLOURS, FAINT, finish, new_figure, report, save, table
from figure_tools.grid_coverage import draw_coverage

from vvc_bench import load_dataset

RESULTS = Path(__file__).parents[2] / "results"
TRAININGS = RESULTS / "trainings"
LADDER = ("irpo1-aug-v0", "irpo2-aug-v0", "irpo3-aug-v0", "learned5-aug-v0")
"""Sets side by side."""
ALONE = {
    "GCBC+PPO from search-v0": "laptop/gcbc-ppo-search-seed0",
    "GCBC+PPO from pid-aug-v0": "laptop/gcbc-ppo-pid-aug-seed0",
    "PPO": "laptop/ppo-seed0",
}
"""Label → what was trained."""


def read(path: Path) -> dict[str, Any]:
    document: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
    return document


def curve(training: dict[str, Any]) -> tuple[list[float], list[float]]:
    """Million steps, and percent of the validation goals reached."""
    judged = training["evaluations"]
    return [each["done"] / 1e6 for each in judged], [100.0 * each["success"]["rate"] for each in judged]


def iterations(seed: int) -> dict[int, dict[str, Any]]:
    """Iteration → what its PPO says of itself."""
    return {int(path.name[0]): read(path) for path in sorted((TRAININGS / "irpo").glob(f"*-seed{seed}-ppo.json"))}


def draw_curves() -> None:
    figure = new_figure(7.4, 3.6)
    axes = figure.subplots()
    ends = np.cumsum([curve(training)[0][-1] for training in iterations(0).values()])
    for seed, marker in enumerate("o^"):
        label = f"IRPO, three iterations, seed {seed}"
        for k, training in iterations(seed).items():
            steps, shares = curve(training)
            places = np.array(steps) + (ends[k - 2] if k > 1 else 0.0)
            axes.plot(places, shares, color=COLOURS[0], linewidth=2 - seed, marker=marker, ms=3, label=label)
            label = "_"
    for end in ends:
        axes.axvline(end, color=FAINT, linewidth=0.8, linestyle=":")
    for colour, (label, trial) in zip(COLOURS[1:], ALONE.items(), strict=False):
        axes.plot(*curve(read(TRAININGS / f"{trial}.json")), color=colour, linewidth=2, label=label)
    axes.legend(frameon=False, fontsize=10, loc="lower right")
    finish(axes, x="million steps of PPO", y="validation goals reached, %")
    save(figure, "learning_curves.png")


def ladder_table() -> str:
    rows = []
    for row in read(RESULTS / "table1-laptop.json")["rows"]:
        ours, paper = row["ours"], row["paper"]
        if row["set"] == "search-v0":
            continue
        rows.append(
            [
                f"`{row['set']}`",
                f"{ours['coverage_percent']:.2f} %",
                f"{paper['coverage_percent']:.2f} %" if paper else "",
                *(f"{ours[name]['mean']:.{digits}f} ± {ours[name]['std']:.{digits}f}" for name, digits in MEASURES),
            ]
        )
    header = ["", "goals reached", "the paper's", "length, steps", "speed error, m/s", "path angle, °", "azimuth, °"]
    return table(header, rows)


MEASURES = (("length_steps", 0), ("speed_error_mps", 2), ("path_angle_error_deg", 2), ("azimuth_error_deg", 2))


def learners_table() -> str:
    """Rows of Tables 2, 3 and 9, each learner once."""
    rows: dict[str, list[str]] = {}
    protocols: list[str] = []
    for name in ("table2", "table3", "table9"):
        for row in read(RESULTS / f"{name}-laptop.json")["rows"]:
            if row["ours"]:
                protocols = list(row["ours"])
                trained = row.get("trainings", ())
                seeds = len(row["policies"])
                amounts = " + ".join(f"{each['done']:,} {each['unit']}" for each in trained[: len(trained) // seeds])
                minutes = sum(each["wall_s"] for each in trained) / 60.0 / seeds
                rows[row["label"]] = [
                    row["label"],
                    *(f"{each['percent']:.1f} ({each['low']:.1f}–{each['high']:.1f})" for each in row["ours"].values()),
                    f"{seeds}" if trained else "",
                    amounts or "ships with the package",
                    f"{minutes:.0f}" if trained else "",
                ]
    return table(["", *(f"{name}, %" for name in protocols), "seeds", "trained for", "minutes"], rows.values())


def main() -> None:
    draw_curves()
    draw_coverage({name.removesuffix("-v0"): load_dataset(name).read() for name in LADDER}, "irpo_coverage.png")
    report("learning.md", {"ladder": ladder_table(), "learners": learners_table()})


if __name__ == "__main__":
    main()
