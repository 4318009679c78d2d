"""The table of best-known flights: what enters it has been flown again, and is shorter."""

import json
from pathlib import Path

import numpy as np
import pytest

from vvc_bench.cli import main
from vvc_bench.datasets.best import (
    CONTESTS,
    BestKnown,
    Submission,
    best_known,
    improved,
    judge,
    read_table,
    write_table,
)
from vvc_bench.datasets.catalogue import HARD, PAPER_GRID
from vvc_bench.experts import PURSUIT
from vvc_bench.metrics import length_ratios
from vvc_bench.metrics.coverage import find_goals
from vvc_bench.rollout import Episodes, fly_law

CONTEST = CONTESTS["hard-grid-v0"]
NOBODY = BestKnown(np.zeros((0, 3)), np.zeros(0, dtype=np.int64), np.zeros(0, dtype=np.str_))


@pytest.fixture(scope="module")
def flown() -> Episodes:
    goals = [[200, 0, 20], [220, 10, 40], [200, 10, -60], [180, -20, 90]]
    return fly_law(HARD, goals, PURSUIT).episodes


@pytest.fixture
def flight(tmp_path: Path) -> Path:
    """One flight, as the command line writes it."""
    options = ["--goal", "220,10,40", "--expert", "pursuit", "--format", "parquet,csv", "--output", str(tmp_path)]
    assert main(["fly", *options]) == 0
    return tmp_path / "goal_220_10_40.parquet"


def submission(episodes: Episodes) -> Submission:
    return Submission(episodes.goals, episodes.actions, episodes.offsets)


def test_a_flight_enters_once(flown: Episodes, tmp_path: Path) -> None:
    first = judge(submission(flown), CONTEST, NOBODY)
    assert first.better.all()
    table = improved(NOBODY, first, "pursuit")
    write_table(table, tmp_path / "table.parquet")
    read = read_table(tmp_path / "table.parquet")
    order = np.lexsort(flown.goals.T[::-1])
    np.testing.assert_array_equal(read.goals, flown.goals[order])
    np.testing.assert_array_equal(read.steps, flown.lengths[order])
    assert set(read.sources) == {"pursuit"}
    assert not judge(submission(flown), CONTEST, read).better.any()
    assert (length_ratios(flown, read.lengths) == 1.0).all()


def test_only_shorter_flights_replace_others(flown: Episodes) -> None:
    known = BestKnown(flown.goals[:2], flown.lengths[:2] + np.array([-1, 1]), np.array(["a", "a"]))
    judged = judge(submission(flown.select([0, 1])), CONTEST, known)
    assert judged.better.tolist() == [False, True]
    after = improved(known, judged, "b")
    assert sorted(zip(after.steps.tolist(), after.sources.tolist(), strict=True)) == sorted(
        [(int(flown.lengths[0] - 1), "a"), (int(flown.lengths[1]), "b")]
    )


def test_what_does_not_reach_or_is_off_the_grid_stays_out(flown: Episodes) -> None:
    one = flown.select([0])
    lazy = submission(one)._replace(actions=np.zeros_like(one.actions))
    assert not judge(lazy, CONTEST, NOBODY).better.any()
    beside = judge(submission(one)._replace(goals=one.goals + np.array([0.5, 0.0, 0.0])), CONTEST, NOBODY)
    assert beside.reached.all()
    assert not beside.better.any()
    assert np.isnan(beside.known_steps).all()


def test_of_several_flights_to_a_goal_the_shortest_counts(flown: Episodes) -> None:
    one = flown.select([0])
    late = np.concatenate([np.repeat([[0.0, 1.0, 0.3]], 5, axis=0).astype(np.float32), one.actions])
    both = Submission(
        np.repeat(one.goals, 2, axis=0),
        np.concatenate([late, one.actions]),
        np.array([0, len(late), len(late) + len(one.actions)]),
    )
    after = improved(NOBODY, judge(both, CONTEST, NOBODY), "me")
    assert after.steps.tolist() == [int(one.lengths[0])]


def test_a_flight_file_is_submitted_from_the_command_line(
    flight: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    table = tmp_path / "own.parquet"
    options = ["--file", str(table), "--json"]
    capsys.readouterr()
    assert main(["best", "submit", str(flight), "--as", "me", *options]) == 0
    assert json.loads(capsys.readouterr().out)["accepted"] == 1
    before = table.read_bytes()
    assert main(["best", "submit", str(flight.with_suffix(".csv")), "--as", "you", *options]) == 1
    assert json.loads(capsys.readouterr().out)["accepted"] == 0
    assert table.read_bytes() == before
    assert main(["best", "verify", str(flight), *options]) == 0
    assert json.loads(capsys.readouterr().out)["mean_time_ratio"] == 1.0
    assert main(["best", "show", "--goal", "220,10,40", *options]) == 0
    (entry,) = json.loads(capsys.readouterr().out)["nearest"]
    assert (entry["speed_mps"], entry["source"]) == (220.0, "me")


def test_the_tables_of_the_package_are_whole() -> None:
    best = best_known()
    assert len(best.goals) > 0.95 * len(PAPER_GRID.goals)
    assert (find_goals(best.goals, PAPER_GRID.goals) >= 0).all()
    assert len(np.unique(best.goals, axis=0)) == len(best.goals)
    assert best.steps.min() >= HARD.task.reach_steps
    assert best.steps.max() <= HARD.task.step_limit


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["show", "--table", "soft-grid-v0"], "unknown table 'soft-grid-v0'; known are hard-grid-v0"),
        (["show", "--goal", "220,10"], "a goal is"),
        (["verify", "no-such-set"], "no-such-set"),
        (["submit", "nowhere.csv", "--as", "me"], "nowhere.csv"),
    ],
)
def test_bad_input_is_named(arguments: list[str], message: str, capsys: pytest.CaptureFixture[str]) -> None:
    try:
        code = main(["best", *arguments])
    except SystemExit as exit_of_the_parser:
        code = exit_of_the_parser.code
    error = capsys.readouterr().err
    assert code == 2
    assert message in error
    assert error.count("\n") == 1


def test_a_file_that_is_no_table_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "table.parquet"
    path.write_bytes(b"not a table")
    assert main(["best", "show", "--file", str(path)]) == 2
    assert "is no table of best-known flights" in capsys.readouterr().err
    assert path.read_bytes() == b"not a table"


def test_another_file_is_no_flight(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "other.csv"
    path.write_text("a,b\n1,2\n3,4\n")
    assert main(["best", "verify", str(path)]) == 2
    assert "is no flight in guidance mode to a goal" in capsys.readouterr().err
