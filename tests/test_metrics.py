"""Measures of flights, against loops over their formulas, published figures and signals with known answers."""

import cmath
import itertools
import json
import math

import numpy as np
import pytest

from vvc_bench import metrics
from vvc_bench.goals import GOAL_COLUMNS, grid
from vvc_bench.metrics.coverage import find_goals
from vvc_bench.metrics.documents import plain
from vvc_bench.metrics.smoothness import frequency_weighted_amplitude, mean_change
from vvc_bench.rollout import Episodes, Flown, Scenario, concatenate, fly_law
from vvc_bench.sim import Settings
from vvc_bench.sim.fields import Observation, columns
from vvc_bench.sim.task import Event
from vvc_bench.tasks import TASKS, make_task

GOALS = grid([120, 180, 240, 300], [-25, -5, 0, 20], [-170, -60, 0, 20, 165]).goals
KEPT_BY_MEANS = Scenario(
    make_task(
        TASKS["hard"].task,
        rules="demonstration",
        direction_band_deg=1,
        step_limit=1200,
        terminations=("reach_target", "crash", "time_limit"),
    )
)
SEEN = {name: k for k, name in enumerate(Observation._fields)}
GOAL = [SEEN[name] for name in ("speed", "path_angle", "azimuth")]


@pytest.fixture(scope="module")
def flown() -> Flown:
    return fly_law(KEPT_BY_MEANS, GOALS)


@pytest.fixture(scope="module")
def episodes(flown: Flown) -> Episodes:
    return flown.episodes


def make(
    seen: list[np.ndarray],
    goals: list[list[float]],
    *,
    actions: list[np.ndarray] | None = None,
    scenario: Scenario = KEPT_BY_MEANS,
    reached: bool = True,
) -> Episodes:
    """Episodes from all that is seen in each, start and end included."""
    lengths = np.array([len(rows) - 1 for rows in seen])
    total = int(lengths.sum())
    offsets = np.concatenate([[0], np.cumsum(lengths)])
    events = np.zeros(total, dtype=np.uint8)
    events[offsets[1:] - 1] = Event.REACH_TARGET if reached else Event.TIME_LIMIT
    width = scenario.settings.command_width
    return Episodes(
        scenario,
        goals=np.array(goals, dtype=np.float64).reshape(-1, 3),
        seeds=np.zeros(len(seen), dtype=np.int64),
        sources=np.full(len(seen), "made"),
        starts=np.repeat(scenario.start[None], len(seen), axis=0),
        offsets=offsets,
        observations=np.concatenate([np.zeros((0, 8)), *(rows[:-1] for rows in seen)]).astype(np.float32),
        final_observations=np.array([rows[-1] for rows in seen], dtype=np.float32).reshape(-1, 8),
        actions=np.zeros((total, width), np.float32) if actions is None else np.concatenate(actions).astype(np.float32),
        rewards=np.full(total, -0.5, dtype=np.float32),
        events=events,
        deflections=np.zeros((total, 4), dtype=np.float32),
        load_factors=np.ones(total, dtype=np.float32),
    )


def reports(episodes: Episodes, e: int) -> np.ndarray:
    """All that was seen in an episode, start and end included."""
    rows = episodes.observations[episodes.offsets[e] : episodes.offsets[e + 1]]
    return np.concatenate([rows, episodes.final_observations[e : e + 1]]).astype(float)


def seen_rows(count: int, **values: object) -> np.ndarray:
    rows = np.zeros((count, 8))
    for name, value in values.items():
        rows[:, SEEN[name]] = value
    return rows


# Smoothness


def slow_s1(signal: list[float]) -> float:
    """Eq. 23 by the definition, one bin after another."""
    samples, bins = len(signal), len(signal) // 2
    total = 0.0
    for k in range(bins):
        transform = sum(x * cmath.exp(-2j * math.pi * k * t / samples) for t, x in enumerate(signal))
        total += 2.0 / samples * abs(transform) * k / (bins - 1)
    return total / bins


@pytest.mark.parametrize(
    ("signal", "s1"),
    [([1, 5, 3, 2, 4], 0.3122623321024132), ([1, 2, 3, 4, 5], 0.85065080835204), ([3, 3, 2, 1, 3], 0.4994424081913666)],
)
def test_s1_is_what_the_authors_code_computed(signal: list[float], s1: float) -> None:
    """Outputs recorded in utils_my/smoothness/test_fourier.ipynb of GongXudong/fly-craft-examples."""
    assert frequency_weighted_amplitude(np.array(signal, dtype=float)) == pytest.approx(s1, rel=1e-12)


def test_both_measures_are_their_definitions_on_real_flights(episodes: Episodes) -> None:
    seen, commanded = metrics.observation_smoothness(episodes), metrics.action_smoothness(episodes)
    assert seen.columns == tuple(columns(Observation))
    for e in np.argsort(episodes.lengths)[[0, 1, len(episodes) // 2]]:
        steps = slice(episodes.offsets[e], episodes.offsets[e + 1])
        for measured, values in ((seen, episodes.observations), (commanded, episodes.actions)):
            for k in range(values.shape[1]):
                signal = values[steps, k].astype(float).tolist()
                changes = [abs(after - before) for before, after in itertools.pairwise(signal)]
                assert measured.s1[e, k] == pytest.approx(slow_s1(signal), rel=1e-9, abs=1e-12)
                assert measured.s2[e, k] == pytest.approx(sum(changes) / len(signal), rel=1e-9, abs=1e-12)


@pytest.mark.parametrize("samples", [40, 41])
def test_signals_with_known_spectra(samples: int) -> None:
    time, bins = np.arange(samples), samples // 2
    assert frequency_weighted_amplitude(np.full(samples, 7.0)) == pytest.approx(0.0, abs=1e-13)
    assert mean_change(np.full(samples, 7.0)) == 0.0

    wave = 3.0 + 2.0 * np.sin(2.0 * math.pi * 5 * time / samples)  # bin 5 alone, of amplitude 2
    assert frequency_weighted_amplitude(wave) == pytest.approx(2.0 * (5 / (bins - 1)) / bins, rel=1e-12)

    spectrum = [k / (bins - 1) / math.sin(math.pi * k / samples) for k in range(1, bins)]  # of a ramp: 1/sin(πk/N)
    assert frequency_weighted_amplitude(1.0 * time) == pytest.approx(sum(spectrum) / bins, rel=1e-12)
    assert mean_change(0.25 * time) == pytest.approx(0.25 * (samples - 1) / samples, rel=1e-12)


def test_short_signals_have_no_frequency() -> None:
    for samples in (1, 2, 3):
        assert frequency_weighted_amplitude(np.arange(float(samples))) == 0.0


def test_a_turn_through_south_is_smooth_once_followed_round() -> None:
    azimuth = (np.arange(101) * 2.0 + 90.0 + 180.0) % 360.0 - 180.0
    turning = make([seen_rows(101, azimuth=azimuth, speed=200.0)], [[200, 0, -70]])
    k = SEEN["azimuth"]
    raw, followed = (metrics.observation_smoothness(turning, unwrapped=choice) for choice in (False, True))
    assert followed.s2[0, k] == pytest.approx(2.0 * 99 / 100)
    assert raw.s2[0, k] == pytest.approx((2.0 * 98 + 358.0) / 100)
    straight = frequency_weighted_amplitude(np.arange(100) * 2.0)
    assert followed.s1[0, k] == pytest.approx(straight)
    assert raw.s1[0, k] != pytest.approx(straight)
    np.testing.assert_array_equal(np.delete(raw.s2, k, axis=1), np.delete(followed.s2, k, axis=1))


# Accuracy


def test_accuracy_is_the_mean_of_the_last_ten_reports_after_steps(episodes: Episodes) -> None:
    errors = metrics.final_errors(episodes)
    for e in range(len(episodes)):
        difference = np.abs(reports(episodes, e)[1:][-10:, GOAL] - episodes.goals[e])
        difference[:, 2] = np.minimum(difference[:, 2], 360.0 - difference[:, 2])
        np.testing.assert_allclose(errors[e], difference.mean(axis=0), rtol=1e-12)


def test_what_was_kept_by_means_over_a_second_is_that_accurate(episodes: Episodes) -> None:
    """The simulator's own criterion, seen through the measure."""
    errors = metrics.final_errors(episodes)
    assert (errors < [10.0, 1.0, 1.0]).all()
    assert (errors.max(axis=0) > [9.0, 0.8, 0.9]).all()  # most flights end as soon as they may


def test_a_second_is_as_many_reports_as_the_frequency_says() -> None:
    twice = Scenario(KEPT_BY_MEANS.task, Settings(frequency_hz=20))
    speeds = np.arange(41.0)
    flights = make([seen_rows(41, speed=speeds), seen_rows(4, speed=speeds[:4])], [[100, 0, 0]] * 2, scenario=twice)
    assert metrics.final_errors(flights)[:, 0].tolist() == [100.0 - speeds[21:].mean(), 98.0]


def test_azimuth_errors_go_the_shorter_way() -> None:
    south = make([seen_rows(30, azimuth=-179.5)], [[0, 0, 179]])
    assert metrics.final_errors(south)[0, 2] == pytest.approx(1.5)


def test_returns_are_sums(episodes: Episodes) -> None:
    expected = [episodes.select([e]).rewards.astype(float).sum() for e in range(len(episodes))]
    np.testing.assert_allclose(metrics.returns(episodes), expected, rtol=1e-12)


# Coverage and intervals


@pytest.mark.parametrize(
    ("successes", "trials", "low", "high"),
    [(81, 263, 0.2553, 0.3662), (15, 148, 0.0624, 0.1605), (0, 20, 0.0, 0.1611), (1, 29, 0.0061, 0.1718)],
)
def test_wilson_intervals_are_the_published_ones(successes: int, trials: int, low: float, high: float) -> None:
    """Newcombe (1998), Statistics in Medicine 17, 857-872, Table I, method 3."""
    interval = metrics.wilson_interval(successes, trials)
    assert (interval.low, interval.high) == (pytest.approx(low, abs=5e-5), pytest.approx(high, abs=5e-5))


def test_wilson_intervals_at_their_ends() -> None:
    low, high = metrics.wilson_interval([0, 5, 0], [5, 5, 0])
    assert (low[0], high[1]) == (0.0, 1.0)
    assert (low[2], high[2]) == (0.0, 1.0)
    with pytest.raises(ValueError, match="between 0 and trials"):
        metrics.wilson_interval(3, 2)
    with pytest.raises(ValueError, match="confidence"):
        metrics.wilson_interval(1, 2, confidence=1.0)


def test_wilson_intervals_hold_the_truth_as_often_as_they_say() -> None:
    draws = np.random.default_rng(0).binomial(60, 0.2, size=20_000)
    low, high = metrics.wilson_interval(draws, 60)
    assert ((low <= 0.2) & (high >= 0.2)).mean() == pytest.approx(0.95, abs=0.02)


def test_coverage_counts_goals_cell_by_cell(flown: Flown) -> None:
    success = (flown.last_events & int(Event.REACH_TARGET)) != 0
    found = metrics.coverage(*metrics.reached_goals(flown.episodes, GOALS[::-1]))
    assert found.flown.shape == found.reached.shape == (4, 4, 5)
    assert (found.flown == 1).all()
    np.testing.assert_array_equal(found.reached.reshape(-1), success)
    assert found.percent == 100.0 * success.mean()
    for axis in range(3):
        slab = found.along(axis)
        for value, tried, reached in zip(*slab, strict=True):
            here = GOALS[:, axis] == value
            assert (tried, reached) == (here.sum(), (here & success).sum())
        assert (
            (slab.interval.low <= slab.reached / slab.flown) & (slab.reached / slab.flown <= slab.interval.high)
        ).all()


def test_coverage_of_ones_own_regions(flown: Flown) -> None:
    goals, reached = metrics.reached_goals(flown.episodes, GOALS)
    edges = [[100, 200, 301], [-90, 0, 90], [-180, 0, 180]]
    found = metrics.coverage(goals, reached, edges)
    climbing_right = (goals[:, 1] >= 0) & (goals[:, 2] >= 0) & (goals[:, 0] >= 200)
    assert found.flown[1, 1, 1] == climbing_right.sum()
    assert found.reached[1, 1, 1] == (climbing_right & reached).sum()
    assert found.flown.sum() == len(goals)
    with pytest.raises(ValueError, match="must ascend"):
        metrics.coverage(goals, reached, [[200, 100], [-90, 90], [-180, 180]])
    with pytest.raises(ValueError, match="along speed_mps, path_angle_deg, azimuth_deg"):
        metrics.coverage(goals, reached, [[100, 200]])


def test_goals_drawn_at_random_get_cells_too() -> None:
    goals = np.random.default_rng(0).uniform([100, -85, -170], [300, 85, 170], size=(5000, 3))
    found = metrics.coverage(goals, goals[:, 1] > 0)
    assert found.flown.shape == (20, 20, 20)
    assert (found.flown.sum(), found.reached.sum()) == (5000, (goals[:, 1] > 0).sum())


def test_a_goal_counts_once_and_zero_has_no_sign() -> None:
    three = make([seen_rows(12)] * 3, [[200, -0.0, 5], [200, 0.0, 5], [100, 0, 5]])
    tried = [[100, 0, 5], [200, 0, 5], [300, 0, 5], [300, 0, 5]]
    assert metrics.coverage(*metrics.reached_goals(three, tried)).percent == pytest.approx(200 / 3)
    assert find_goals(three.goals, np.array([[200.0, 0.0, 5.0]])).tolist() == [0, 0, -1]


def test_failures_do_not_cover_and_strangers_are_refused() -> None:
    failed = make([seen_rows(12)], [[200, 0, 5]], reached=False)
    assert metrics.coverage(*metrics.reached_goals(failed, [[200, 0, 5], [100, 0, 5]])).percent == 0.0
    with pytest.raises(ValueError, match=r"goal \(200, 0, 5\) was reached but is not among the 1 goals flown"):
        metrics.reached_goals(make([seen_rows(12)], [[200, 0, 5]]), [[100, 0, 5]])


# Settling


def test_arrival_swing_and_settling_of_a_made_flight() -> None:
    speed = np.array([170, 180, 195, 205, 216, 212, 205, 200, 200, 200, 200], dtype=float)
    response = metrics.responses(make([seen_rows(11, speed=speed)], [[200, 0, 0]])).speed
    assert response.arrival_s[0] == pytest.approx(0.2)
    assert response.overshoot[0] == pytest.approx(6.0)
    assert response.settling_s[0] == pytest.approx(0.6)


def test_flights_that_never_come_or_do_not_stay() -> None:
    never = seen_rows(5, speed=100.0)
    leaves = seen_rows(5, speed=np.array([200, 200, 200, 200, 230.0]))
    there = seen_rows(5, speed=200.0)
    response = metrics.responses(make([never, leaves, there], [[200, 0, 0]] * 3)).speed
    np.testing.assert_array_equal(response.arrival_s, [np.nan, 0.0, 0.0])
    np.testing.assert_array_equal(response.overshoot, [np.nan, 20.0, 0.0])
    np.testing.assert_array_equal(response.settling_s, [np.nan, np.nan, 0.0])


def test_directions_settle_as_angles_between_vectors_do(episodes: Episodes) -> None:
    direction = metrics.responses(episodes).direction
    for e in range(0, len(episodes), 7):
        rows = np.radians(reports(episodes, e)[:, GOAL[1:]])
        goal = np.radians(episodes.goals[e, 1:])
        cosine = np.sin(rows[:, 0]) * np.sin(goal[0]) + np.cos(rows[:, 0]) * np.cos(goal[0]) * np.cos(
            rows[:, 1] - goal[1]
        )
        inside = np.degrees(np.arccos(np.minimum(cosine, 1.0))) < 3.0
        assert direction.arrival_s[e] == pytest.approx(0.1 * np.argmax(inside))
        assert inside[-1]
        assert direction.settling_s[e] == pytest.approx(0.1 * (len(inside) - np.argmin(inside[::-1])))


# Wear


def test_wear_of_made_commands() -> None:
    first = np.array([[-180, 1, 0], [180, 1, 0.5], [180, 9, 1], [0, -4, 1]])
    second = np.array([[-180, 1, 0.2]] * 6)
    flights = make([seen_rows(5), seen_rows(7)], [[200, 0, 0], [210, 0, 0]], actions=[first, second])
    flights.deflections[:, 1] = [0, 1, -1, -1, -25, -20, -20, -20, -20, -20]
    flights.load_factors[:] = [1, 9.5, 1, 1, 1, 1, -4.5, -5, 1, 1]
    measured = metrics.wear(flights)
    roll, load, throttle = measured.commands.values()
    assert (roll.at_low_percent, roll.at_high_percent, roll.bang_bang_percent) == (70.0, 20.0, 90.0)
    assert roll.switches_per_s == pytest.approx(1.0)  # one in ten steps of 0.1 s; not from one flight to the next
    assert (load.at_low_percent, load.at_high_percent) == (10.0, 10.0)
    assert (throttle.at_low_percent, throttle.at_high_percent, throttle.switches_per_s) == (10.0, 20.0, 0.0)
    elevator = measured.deflections["elevator_deg"]
    assert elevator.travel_per_s == pytest.approx(1 + 2 + 0 + 5)
    assert elevator.saturated_percent == 10.0
    assert (measured.load.least_g, measured.load.largest_g) == (-5.0, 9.5)
    assert (measured.load.below_percent, measured.load.above_percent) == (20.0, 10.0)
    assert measured.load.episodes_beyond_percent == 100.0
    assert metrics.wear(flights, high_limit_g=9.5).load.episodes_beyond_percent == 50.0


def test_wear_of_real_flights_is_what_a_loop_finds(episodes: Episodes) -> None:
    measured = metrics.wear(episodes)
    travel = [
        np.abs(np.diff(episodes.select([e]).deflections.astype(float), axis=0)).sum(axis=0)
        for e in range(len(episodes))
    ]
    rates = np.sum(travel, axis=0) / (0.1 * len(episodes.rewards))
    assert [part.travel_per_s for part in measured.deflections.values()] == pytest.approx(rates.tolist(), rel=1e-9)
    full = (episodes.actions[:, 2] == 1.0).mean() * 100.0
    assert measured.commands["throttle"].at_high_percent == pytest.approx(full)


# Time


def test_time_against_the_best_known_flight() -> None:
    fast, slow = (make([seen_rows(length + 1)], [[200, 0, 5]]) for length in (20, 30))
    other = make([seen_rows(11)], [[100, 0, 5]])
    best = metrics.best_lengths([slow, fast, other])
    assert best.goals.tolist() == [[100, 0, 5], [200, 0, 5]]
    assert best.steps.tolist() == [10, 20]
    both = concatenate([slow, fast, make([seen_rows(11)], [[300, 0, 5]])])
    np.testing.assert_array_equal(metrics.length_ratios(both, best), [1.5, 1.0, np.nan])
    measured = metrics.time_optimality(both, best)
    assert (measured.compared, measured.ratio.mean, measured.shortest_percent) == (2, 1.25, 50.0)


def test_failed_flights_are_no_best_ones() -> None:
    failed = make([seen_rows(5)], [[200, 0, 5]], reached=False)
    reached = make([seen_rows(21)], [[200, 0, 5]])
    assert metrics.best_lengths([failed, reached]).steps.tolist() == [20]
    assert metrics.time_optimality(failed, metrics.best_lengths([reached])).compared == 0


# Integrity


def test_repetitions_and_dead_columns_are_found(episodes: Episodes) -> None:
    assert metrics.integrity(episodes) == (0, 0, {})
    twice = concatenate([episodes, episodes.select([0, 3])])
    assert metrics.integrity(twice)[:2] == (2, 2)
    other = episodes.select([0])
    other.actions[0, 0] += np.float32(1e-3)
    assert metrics.integrity(concatenate([episodes, other]))[:2] == (1, 0)
    level = episodes.select(np.arange(len(episodes)))
    level.observations[:, 0] = 0.0
    level.rewards[:] = -1.0
    assert metrics.integrity(level).constant_columns == {
        "observations": ("roll_deg",),
        "rewards": ("rewards",),
    }


# Everything


def test_the_summary_is_table_1_of_the_flights(flown: Flown) -> None:
    row = metrics.summary(flown.episodes, GOALS).table_1
    assert row.trajectories == len(flown.episodes)
    assert row.transitions == len(flown.episodes.rewards)
    assert row.coverage_percent == pytest.approx(100.0 * len(flown.episodes) / len(GOALS))
    assert row.length_steps == (
        pytest.approx(flown.episodes.lengths.mean()),
        pytest.approx(flown.episodes.lengths.std()),
    )
    assert row.azimuth_error_deg.mean == pytest.approx(metrics.final_errors(flown.episodes)[:, 2].mean())


def test_the_document_is_plain_and_the_same_every_time(flown: Flown) -> None:
    best = metrics.best_lengths([flown.episodes])
    document = metrics.summary(flown.episodes, GOALS, best).to_json()
    text = json.dumps(document, allow_nan=False)
    assert json.loads(text) == document
    again = flown.episodes.select(np.arange(len(flown.episodes)))
    assert json.dumps(metrics.summary(again, GOALS, best).to_json(), allow_nan=False) == text
    assert document["time_optimality"]["shortest_percent"] == 100.0
    assert set(document["coverage"]) == set(GOAL_COLUMNS)
    assert sum(document["coverage"]["azimuth_deg"]["reached"]) == document["table_1"]["trajectories"]
    assert set(document["table_12"]["unwrapped"]) == {"roll_deg", "yaw_deg", "azimuth_deg"}


def test_a_set_without_flights_has_a_summary(episodes: Episodes) -> None:
    document = metrics.summary(episodes.select(np.zeros(0, dtype=int)), GOALS).to_json()
    assert document["table_1"]["coverage_percent"] == 0.0
    assert document["table_1"]["length_steps"] == {"mean": None, "std": None}
    json.dumps(document, allow_nan=False)


def test_end_to_end_flights_have_measures_too() -> None:
    scenario = Scenario(KEPT_BY_MEANS.task, Settings("end_to_end"))
    document = metrics.summary(make([seen_rows(12)], [[200, 0, 0]], scenario=scenario), [[200, 0, 0]]).to_json()
    assert set(document["table_12"]["actions"]) == {"aileron_deg", "elevator_deg", "rudder_deg", "throttle"}
    assert document["wear"]["commands"]["throttle"]["at_low_percent"] == 100.0


def test_documents_hold_plain_values_only() -> None:
    given = {"a": np.float32(0.1), "b": (np.int64(3), float("nan")), "c": metrics.Spread(1 / 3, 0.0), "d": np.arange(2)}
    assert plain(given) == {"a": 0.100000001, "b": [3, None], "c": {"mean": 0.333333333, "std": 0.0}, "d": [0, 1]}
    with pytest.raises(TypeError, match="set has no form as JSON"):
        plain({1})


def test_published_figures_are_table_1s() -> None:
    """Their fields are ours, and the paper's figures agree with each other."""
    for published in metrics.PUBLISHED.values():
        for row in published.table_1.values():
            assert set(row) <= set(metrics.Table1._fields)
    paper = metrics.PUBLISHED["pid-v0"].table_1["paper"]
    assert paper["trajectories"] / 50_715 == pytest.approx(paper["coverage_percent"] / 100, abs=5e-5)
    assert paper["length_steps"].mean * paper["trajectories"] == pytest.approx(paper["transitions"], rel=5e-5)
