"""Comparisons: goal by goal, refused where they would mean nothing, and right about who wins where."""

import dataclasses
import json
from collections.abc import Callable

import numpy as np
import pytest
from small_evaluations import goals_of, made_up

from vvc_bench import metrics
from vvc_bench.evaluation import Evaluation
from vvc_bench.evaluation.aggregate import aggregate
from vvc_bench.evaluation.comparison import Comparison, compare
from vvc_bench.evaluation.methods import gather
from vvc_bench.goals import GOAL_COLUMNS


def compared(*labelled: tuple[str, Evaluation], seed: int = 0) -> Comparison:
    return compare(gather(labelled), np.random.default_rng(seed))


def generator() -> np.random.Generator:
    return np.random.default_rng(0)


def test_pairs_are_counted_goal_by_goal() -> None:
    first, second = made_up("a", 0.7), made_up("b", 0.4, draw=1)
    found = compared(("b", second), ("a", first))
    reached, other = (each.episodes["success"].to_numpy() for each in (first, second))
    assert [contender.label for contender in found.contenders] == ["a", "b"]
    (pair,) = found.pairs
    assert (pair.first_only, pair.second_only) == ((reached & ~other).sum(), (other & ~reached).sum())
    assert pair.p_value == pair.adjusted_p_value == metrics.mcnemar(pair.first_only, pair.second_only)
    assert pair.difference.value == pytest.approx(reached.mean() - other.mean())
    assert pair.difference.low < pair.difference.value < pair.difference.high
    assert pair.better == "a"
    assert [contender.rank for contender in found.contenders] == [(1, 1), (2, 2)]
    wilson = metrics.wilson_interval(reached.sum(), len(reached))
    assert found.contenders[0].success == (reached.mean(), float(wilson.low), float(wilson.high))


def test_what_is_not_found_leaves_ranks_open() -> None:
    found = compared(*((name, made_up(name, 0.5, draw=k)) for k, name in enumerate("abc")), ("d", made_up("d", 0.02)))
    ranks = {contender.label: contender.rank for contender in found.contenders}
    assert ranks == {"a": (1, 3), "b": (1, 3), "c": (1, 3), "d": (4, 4)}
    plain = [pair.p_value for pair in found.pairs]
    assert [pair.adjusted_p_value for pair in found.pairs] == pytest.approx(metrics.holm(plain).tolist())
    assert [pair.better for pair in found.pairs] == [
        "",
        "",
        found.pairs[2].first,
        "",
        *[p.first for p in found.pairs[4:]],
    ]


def test_the_same_flights_again_prove_nothing_more() -> None:
    """A policy without chance gives each seed the same outcomes: goals count, not flights."""

    def repeated(evaluation: Evaluation, times: int) -> Evaluation:
        parts = [evaluation.episodes.assign(seed=seed) for seed in range(times)]
        rows = type(evaluation.episodes)(np.concatenate([part.to_numpy() for part in parts]), columns=parts[0].columns)
        rows = rows.astype(evaluation.episodes.dtypes.to_dict())
        return dataclasses.replace(
            evaluation, episodes=rows, summary=evaluation.summary | {"seeds": list(range(times))}
        )

    first, second = made_up("a", 0.55), made_up("b", 0.5, draw=1)
    once = compared(("a", first), ("b", second))
    twice = compared(("a", repeated(first, 5)), ("b", repeated(second, 5)))
    assert twice.pairs == once.pairs
    assert [each.success for each in twice.contenders] == [each.success for each in once.contenders]
    uneven = compared(("a", repeated(first, 2)), ("b", repeated(second, 3)))
    assert uneven.pairs[0].p_value == pytest.approx(once.pairs[0].p_value)


def test_runs_of_a_method_are_compared_together() -> None:
    runs = [made_up("bc", 0.6, draw=k) for k in range(4)]
    found = compared(*(("bc", run) for run in runs), ("random", made_up("random", 0.05, draw=9)))
    best = found.contenders[0]
    assert (best.label, best.policies, best.flights) == ("bc", 4, 4)
    np.testing.assert_array_equal(best.reached, sum(run.episodes["success"].to_numpy().astype(int) for run in runs))
    rates = [100.0 * run.episodes["success"].mean() for run in runs]
    over_runs = best.aggregates["success_percent"]
    assert over_runs.runs == {"hard-1k-v0": 4}
    assert over_runs.mean_std == (pytest.approx(np.mean(rates)), pytest.approx(np.std(rates)))
    assert over_runs.interquartile_mean.value == pytest.approx(np.sort(rates)[1:3].mean())
    assert over_runs.interquartile_mean.low < over_runs.interquartile_mean.value < over_runs.interquartile_mean.high


def test_where_each_wins() -> None:
    def left(goals: np.ndarray) -> np.ndarray:
        return (goals[:, 2] < 0).astype(float)

    def right(goals: np.ndarray) -> np.ndarray:
        return (goals[:, 2] > 0).astype(float)

    found = compared(("left", made_up("left", left)), ("right", made_up("right", right)))
    (pair,) = found.pairs
    np.testing.assert_array_equal(
        np.sign(found.wins(pair)), np.sign(goals_of(400)[:, 2]) * (1, -1)[pair.first == "left"]
    )
    where = found.to_json()["pairs"][0]["where"]
    assert set(where) == set(GOAL_COLUMNS)
    azimuth = where["azimuth_deg"]
    left_wins = azimuth["first_only" if pair.first == "left" else "second_only"]
    assert left_wins[2:] == [0, 0]
    assert sum(left_wins) == (goals_of(400)[:, 2] < 0).sum()
    assert sum(azimuth["goals"]) == 400
    speed = where["speed_mps"]
    assert sum(speed["first_only"]) == pair.first_only
    assert sum(speed["second_only"]) == pair.second_only


def test_other_protocols_are_refused() -> None:
    with pytest.raises(ValueError, match=r"same protocol.*hard-1k-v0 \([0-9a-f]{12}\), easy-1k-v0"):
        compared(("a", made_up("a", 0.5)), ("b", made_up("b", 0.5, protocol="easy-1k-v0")))
    changed = made_up("b", 0.5, draw=1)
    changed.summary["protocol"]["hash"] = "0" * 64
    with pytest.raises(ValueError, match="same protocol"):
        compared(("a", made_up("a", 0.5)), ("b", changed))
    other_goals = made_up("b", 0.5, draw=1)
    other_goals.episodes["goal_speed_mps"] += 1.0
    with pytest.raises(ValueError, match="hold different goals"):
        compared(("a", made_up("a", 0.5)), ("b", other_goals))


def test_one_is_not_enough() -> None:
    with pytest.raises(ValueError, match="two or more evaluations"):
        compared(("a", made_up("a", 0.5)))
    with pytest.raises(ValueError, match="holds the policy a twice on hard-1k-v0"):
        gather([("a", made_up("a", 0.5)), ("a", made_up("a", 0.6))])


def test_the_document_is_plain_and_follows_the_seed() -> None:
    labelled = [("bc", made_up("bc", 0.6, draw=k)) for k in range(3)] + [("random", made_up("random", 0.05))]
    text = json.dumps(compared(*labelled).to_json(), allow_nan=False)
    assert json.dumps(compared(*labelled).to_json(), allow_nan=False) == text
    assert json.dumps(compared(*labelled, seed=1).to_json(), allow_nan=False) != text


def test_scores_are_stratified_by_protocol() -> None:
    """Protocols of different difficulty widen no interval; what counts is the spread of runs on each."""
    easy = [made_up("bc", 0.9, draw=k, protocol="easy-1k-v0") for k in range(4)]
    hard = [made_up("bc", 0.2, draw=k) for k in range(4)]
    both = aggregate([*easy, *hard], "success_percent", generator())
    assert both.over == "policies"
    assert both.runs == {"easy-1k-v0": 4, "hard-1k-v0": 4}
    width = both.interquartile_mean.high - both.interquartile_mean.low
    assert 0.0 < width < 15.0
    rates = [[run.episodes["success"].mean() for run in runs] for runs in (easy, hard)]
    within = np.sqrt(np.mean([np.var(part) for part in rates]))
    assert both.mean_std == (pytest.approx(100.0 * np.mean(rates)), pytest.approx(100.0 * within))


def test_one_policy_has_its_seeds_for_runs() -> None:
    evaluation = made_up("bc", 0.5, seeds=(0, 1, 2))
    found = aggregate([evaluation], "return", generator())
    means = evaluation.episodes.groupby("seed")["return"].mean()
    assert (found.over, found.runs) == ("seeds", {"hard-1k-v0": 3})
    assert found.mean_std.mean == pytest.approx(means.mean())
    alone = aggregate([made_up("bc", 0.5)], "return", generator())
    assert np.isnan(alone.interquartile_mean.low)


@pytest.mark.parametrize(
    "call", [lambda: aggregate([], "return", generator()), lambda: aggregate([made_up("a", 0.5)], "speed", generator())]
)
def test_scores_that_are_none_are_refused(call: Callable[[], object]) -> None:
    with pytest.raises(ValueError, match="success_percent, return"):
        call()
