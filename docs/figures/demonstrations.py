"""The pictures of `pid-v0` in the README, as its data card has them.

    python docs/figures/demonstrations.py

Writes docs/figures/pid_coverage.png and pid_paths.png; builds the set if it is not on this machine.
"""

import tempfile
from pathlib import Path

from figure_tools import DOCS

from vvc_bench import load_dataset
from vvc_bench.datasets.card import write_dataset_card

PICTURES = {"coverage-by-speed.png": "pid_coverage.png", "paths.png": "pid_paths.png"}


def main() -> None:
    dataset = load_dataset("pid-v0")
    with tempfile.TemporaryDirectory() as folder:
        write_dataset_card(dataset, folder)
        for drawn, shown in PICTURES.items():
            (DOCS / "figures" / shown).write_bytes(Path(folder, drawn).read_bytes())


if __name__ == "__main__":
    main()
