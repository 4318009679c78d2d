"""Read the table of flights that is claimed: the module that runs confined, with ``episodes.parquet`` in its folder.

A few megabytes of Parquet may stand for any number of gigabytes, and no header says so that could be believed.
"""

from pathlib import Path

from vvc_bench.leaderboard.reflight import answer
from vvc_bench.leaderboard.submission import EPISODES


def _read() -> None:
    from vvc_bench.evaluation.evaluate import read_episodes

    read_episodes(Path(EPISODES))


if __name__ == "__main__":
    answer(_read)
