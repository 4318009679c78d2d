"""The rules, paper's and public code's side by side: each difference between them would be noticed here."""

import itertools
import math

import gymnasium
import numpy as np
import pytest
from test_environments import LEVEL, fly_until_the_end, needs_vectors

import vvc_bench  # noqa: F401  (registers the ids)
from vvc_bench import sim
from vvc_bench.goals import SCALE
from vvc_bench.sim.fields import Goal
from vvc_bench.sim.task import (
    Event,
    Outcome,
    Rules,
    Task,
    direction_error,
    distance_reward,
    failure_penalty,
    fresh_memory,
    judge,
    judge_publicly,
    outcomes,
    window_width,
)
from vvc_bench.sim.units import DEGREES_PER_RADIAN
from vvc_bench.tasks import TASKS, make_task

PAPER, PUBLIC_CODE = TASKS["hard"].task, TASKS["flycraft"].task
NORTH = Goal(speed=200.0, path_angle=0.0, azimuth=0.0)
START = sim.State(*sim.start(sim.Settings()).ravel()[: len(sim.State._fields)])


def report(path_angle_deg: float = 0.0, azimuth_deg: float = 0.0, **others: float) -> sim.State:
    """A report of level flight at 200 m/s in another direction."""
    return START._replace(path_angle=math.radians(path_angle_deg), azimuth=math.radians(azimuth_deg), **others)


def judged(task: Task, reports: list[sim.State], goal: Goal = NORTH) -> list[Outcome]:
    """What each report but the first, which is the initial one, means."""
    memory = fresh_memory(task, reports[0], goal)
    window = np.zeros((1, window_width(task)))
    if task.rules == Rules.PUBLIC_CODE:
        window[0, :2] = abs(goal.speed - reports[0].speed), memory.direction_error
    results = []
    for before, after in itertools.pairwise(reports):
        if task.rules == Rules.PUBLIC_CODE:
            outcome = judge_publicly(task, memory, window, 0, before.roll, after, goal)
        else:
            outcome = judge(task, memory, before.roll, after, goal)
        memory = outcome.memory
        results.append(outcome)
    return results


def first_step(event: Event, task: Task, reports: list[sim.State]) -> int | None:
    """The step of the first report with that event."""
    return next((i for i, outcome in enumerate(judged(task, reports), 1) if outcome.events & event), None)


@pytest.mark.parametrize(
    ("errors_deg", "paper", "public_code"),
    [
        ([1] * 30, 10, 9),  # the mean counts the initial report
        ([60] + [1] * 30, 10, 10),  # which is too far off here
        ([1] * 6 + [4] + [1] * 30, 16, 9),  # a mean forgives a report outside the band
        ([2.8, 3.3] * 15, None, None),
        ([2.8, 3.1] * 15, None, 9),
        ([2.9] * 30, 10, 9),
    ],
)
def test_reached_is_each_of_the_last_reports_or_their_mean(
    errors_deg: list, paper: int | None, public_code: int | None
) -> None:
    for task, expected in ((PAPER, paper), (PUBLIC_CODE, public_code)):
        for reports in (
            [report(azimuth_deg=error) for error in errors_deg],
            [report(speed=200.0 - 10.0 / 3.0 * error) for error in errors_deg],
        ):
            assert first_step(Event.REACH_TARGET, task, reports) == expected


def moving(path_angle_deg: tuple[float, float], azimuth_deg: tuple[float, float], steps: int = 40) -> list[sim.State]:
    """Reports whose direction moves evenly."""
    angles = np.linspace(*zip(path_angle_deg, azimuth_deg, strict=True), steps + 1)
    return [report(path_angle, azimuth) for path_angle, azimuth in angles]


@pytest.mark.parametrize(
    ("reports", "paper", "public_code"),
    [
        (moving((5, 10), (5, 10)), 20, 21),  # the public code does not look at the initial report
        (moving((10, 5), (20, 60)), 20, None),  # only the azimuth error grows
        (moving((5, 40), (20, 19)), 20, None),  # only the path-angle error grows
        (moving((0.1, 0.9), (0.1, 0.9)), 20, None),  # ignored below 1°
        (moving((10, 5), (10, 5)), None, None),
    ],
)
def test_moving_away_is_of_the_velocity_vector_or_of_both_its_angles(
    reports: list, paper: int | None, public_code: int | None
) -> None:
    assert first_step(Event.MOVE_AWAY, PAPER, reports) == paper
    assert first_step(Event.MOVE_AWAY, PUBLIC_CODE, reports) == public_code


@pytest.mark.parametrize("steps", [1, 5, 20, 30])
def test_limits_in_steps_count_from_the_last_interruption(steps: int) -> None:
    away = moving((5, 10), (5, 10))
    interrupted = [*away[:4], *away]
    task = make_task(PAPER, move_away_steps=steps)
    assert first_step(Event.MOVE_AWAY, task, away) == steps
    assert first_step(Event.MOVE_AWAY, task, interrupted) == (steps if steps <= 3 else 4 + steps)

    banked, level = report(roll=math.radians(70), load_factor=-0.5), report()
    not_steep, not_negative = banked._replace(roll=math.radians(59)), banked._replace(load_factor=0.1)
    for rules in ("paper", "public_code"):
        task = make_task(PAPER, negative_load_steps=steps, rules=rules)
        for pause in (not_steep, not_negative):
            reports = [level, banked, banked, banked, pause, *[banked] * 30]
            expected = steps if steps <= 3 else 4 + steps
            assert first_step(Event.NEGATIVE_LOAD_BANKED, task, reports) == expected

    task = make_task(PAPER, reach_steps=steps)
    reports = [report(), report(), report(), report(azimuth_deg=4), *[report()] * 30]
    assert first_step(Event.REACH_TARGET, task, reports) == (steps if steps <= 2 else 3 + steps)


def oracle(task: Task, flown: dict[str, np.ndarray]) -> set[int]:
    """Steps at which a run of steps in a row is long enough, from what infos and observations say."""

    def long_enough(condition: np.ndarray, steps: float) -> set[int]:
        run = np.convolve(condition, np.ones(int(steps)))[: len(condition)]
        return set(np.flatnonzero(run >= steps) + 1)

    errors = flown["direction_error_deg"]
    near = (np.abs(flown["speed_error_mps"]) < 10) & (errors[1:] < 3)
    banked = (np.abs(flown["roll_deg"]) > 60) & (flown["load_factor_g"] < 0)
    return (
        long_enough(near, task.reach_steps)
        | long_enough(np.diff(errors) > 0, task.move_away_steps)
        | long_enough(banked, task.negative_load_steps)
    )


def fly_with_records(environment: gymnasium.Env, seed: int) -> tuple[dict[str, np.ndarray], dict]:
    """Short pieces of flight near the start, or banked with a push, until the end."""
    rng = np.random.default_rng(seed)
    goal = (rng.uniform(195, 205), rng.uniform(-4, 4), rng.uniform(-8, 8))
    observed, _ = environment.reset(options={"goal": goal})
    start, wanted = (observed[name].astype(float) / SCALE for name in ("achieved_goal", "desired_goal"))
    angle = direction_error(*start[1:], Goal(*wanted)) * DEGREES_PER_RADIAN
    records: dict[str, list] = {"direction_error_deg": [angle], "speed_error_mps": [], "roll_deg": []}
    records["load_factor_g"] = []
    for step in range(400):
        if step % 12 == 0:
            roll_rate, pull = rng.uniform(-25, 25), rng.choice([1.0, -1.0])
        observed, _, terminated, truncated, info = environment.step([roll_rate, pull, 0.15])
        for name, values in records.items():
            values.append(observed["observation"][0] if name == "roll_deg" else info[name])
        if terminated or truncated:
            return {name: np.array(values) for name, values in records.items()}, info
    raise AssertionError("it never ends")


@pytest.mark.parametrize(
    "variant",
    [
        {"reach_steps": 1},
        {"reach_steps": 5},
        {"reach_steps": 30},
        {"move_away_steps": 1},
        {"move_away_steps": 7},
        {"move_away_steps": 400, "negative_load_steps": 1},
        {"move_away_steps": 400, "negative_load_steps": 9},
    ],
)
def test_non_markovian_variants_end_where_their_history_says(variant: dict) -> None:
    environment = gymnasium.make("VVC/Hard-v0", largest_roll_on_deg=1e6, **variant)
    ends = []
    for seed in range(40):
        flown, info = fly_with_records(environment, seed)
        expected = oracle(environment.unwrapped.task, flown)
        if info["termination"] in ("crash", "extreme_state", "time_limit"):
            assert not expected
            continue
        assert expected == {int(info["steps"])}
        ends.append(info["termination"])
    varied = {"reach_steps": "reach_target", "move_away_steps": "move_away"}
    varied["negative_load_steps"] = "negative_load_banked"
    assert varied[list(variant)[-1]] in ends


def test_the_public_code_adds_the_dense_reward_to_final_steps() -> None:
    away, near = moving((5, 10), (5, 10)), [report(azimuth_deg=1)] * 12
    for task, added in ((PAPER, 0.0), (PUBLIC_CODE, 1.0)):
        step = first_step(Event.MOVE_AWAY, task, away)
        outcome = judged(task, away)[step - 1]
        dense = distance_reward(outcome.speed_error, outcome.direction_error, task)
        assert dense < -0.05
        assert outcome.reward == pytest.approx(failure_penalty(step, task) + added * dense)
        step = first_step(Event.REACH_TARGET, task, near)
        outcome = judged(task, near)[step - 1]
        dense = distance_reward(outcome.speed_error, outcome.direction_error, task)
        assert outcome.reward == pytest.approx(added * dense)


def test_the_public_codes_time_is_up_one_step_early_and_costs_1() -> None:
    for environment_id, steps, terminated, cost in (
        ("VVC/Hard-v0", 400, False, 0.0),
        ("VVC/FlyCraft-v0", 399, True, -1.0),
    ):
        environment = gymnasium.make(environment_id, terminations=("reach_target", "time_limit"))
        rewards, info = fly_until_the_end(environment, LEVEL, (200, 0, 90))
        assert (len(rewards), info["termination"]) == (steps, "time_limit")
        assert (info["terminated"], info["truncated"]) == (terminated, True)
        assert rewards[-1] == pytest.approx(rewards[-2] + cost, abs=1e-3)  # the dense reward hardly changes


@pytest.mark.parametrize("event", ["crash", "extreme_state"])
def test_the_public_code_also_truncates_crashes_and_extreme_states(event: str) -> None:
    for environment_id, truncated in (("VVC/Hard-v0", False), ("VVC/FlyCraft-v0", True)):
        environment = gymnasium.make(environment_id, terminations=(event,), largest_speed_mps=230, altitude_m=1000)
        _, info = fly_until_the_end(environment, [0.0, 0.0, 1.0], (200, 0, 90))
        assert (info["terminated"], info["truncated"], info["termination"]) == (True, truncated, event)


AT_ONCE = [
    {Event.REACH_TARGET, Event.CRASH},
    {Event.CRASH, Event.EXTREME_STATE},
    {Event.EXTREME_STATE, Event.TIME_LIMIT},
    {Event.TIME_LIMIT, Event.MOVE_AWAY},
    {Event.MOVE_AWAY, Event.ROLL_ON},
    {Event.ROLL_ON, Event.NEGATIVE_LOAD_BANKED},
]


@pytest.mark.parametrize("together", AT_ONCE, ids=lambda events: "-".join(sorted(event.name for event in events)))
def test_of_events_at_once_the_public_code_takes_the_first_of_its_order(together: set[Event]) -> None:
    """Two events in the first step, whose reward and truncation tell which counted."""
    reaching = Event.REACH_TARGET in together
    start = report(path_angle_deg=0 if reaching else 30, azimuth_deg=0 if reaching else 30)
    after = start._replace(
        path_angle=start.path_angle * 1.01,
        azimuth=start.azimuth * 1.01,
        altitude=-1.0,
        roll_rate=math.radians(301.0),
        roll=math.radians(90.0),
        load_factor=-1.0,
    )
    terminations = {"terminations": tuple(together)}
    at_once = {"reach_steps": 1, "step_limit": 1, "largest_roll_on_deg": 80}
    ones = {"move_away_steps": 1, "negative_load_steps": 1, "penalty": "constant", "constant_penalty": -50}
    for task in (PAPER, PUBLIC_CODE):
        chosen = make_task(task, **terminations, **at_once, **ones)
        if task is PUBLIC_CODE:
            chosen = chosen._replace(step_limit=3.0)
            outcome = judged(chosen, [start, start, after])[-1]
        else:
            outcome = judged(chosen, [start, after])[-1]
        assert Event(outcome.events) == sum(together, Event(0))
        terminated, truncated = outcomes(chosen, outcome.events)
        assert terminated
        first = min(together)
        if task is PUBLIC_CODE:
            assert truncated == (first in (Event.CRASH, Event.EXTREME_STATE, Event.TIME_LIMIT))
            dense = distance_reward(outcome.speed_error, outcome.direction_error, chosen)
            penalty = 0.0 if reaching else -50.0
            assert outcome.reward == pytest.approx(dense + penalty)
        else:
            assert not truncated
            assert outcome.reward == (0.0 if reaching else -50.0)


def test_observations_have_the_reference_layout() -> None:
    environment = gymnasium.make("VVC/FlyCraft-v0")
    environment.reset(seed=0, options={"goal": (210, 20, -30)})
    for _ in range(25):
        observed, *_ = environment.step([30.0, 2.0, 0.7])
    state = environment.unwrapped.state
    angles = [state.roll, state.pitch, state.yaw, state.path_angle, state.azimuth, state.roll_rate]
    phi, theta, psi, mu, chi, p = np.degrees(angles)
    expected = [phi, theta, psi, state.speed, mu, chi, p, state.altitude]
    np.testing.assert_allclose(observed["observation"], expected, rtol=1e-6)
    assert len({round(value, 3) for value in expected}) == len(expected)
    np.testing.assert_allclose(observed["achieved_goal"], [state.speed, mu, chi], rtol=1e-6)
    np.testing.assert_array_equal(observed["desired_goal"], [210, 20, -30])


@pytest.mark.parametrize(("rules", "steps"), [("paper", 10), ("public_code", 9), ("demonstration", 10)])
def test_a_new_goal_restarts_what_counts_towards_reaching(rules: str, steps: int) -> None:
    environment = gymnasium.make("VVC/Hard-v0", rules=rules).unwrapped
    environment.reset(seed=0, options={"goal": (200, 0, 0)})
    for _ in range(steps - 1):
        assert not environment.step(LEVEL)[2]
    environment.set_goal((201, 0, 0))
    for step in range(1, steps + 1):
        assert environment.step(LEVEL)[2] == (step == steps)


def test_a_new_goal_restarts_moving_away_but_neither_rolling_on_nor_the_clock() -> None:
    environment = gymnasium.make("VVC/Hard-v0", move_away_steps=20, terminations=("move_away",)).unwrapped
    environment.reset(seed=0, options={"goal": (200, 0, -60)})
    for _ in range(35):  # a turn to the right, after a moment
        environment.step([0.0 if environment.state.roll > 1.0 else 60.0, 2.0, 0.4])
        if environment.fleet.events[0]:
            break
    assert environment.fleet.events[0] == Event.MOVE_AWAY
    environment.set_goal((200, 0, -90))
    ended = [environment.step([0.0, 2.0, 0.4])[2] for _ in range(20)]
    assert ended == [False] * 19 + [True]

    environment = gymnasium.make("VVC/Hard-v0", terminations=("roll_on", "time_limit"), step_limit=150).unwrapped
    lengths = []
    for changes in (False, True):
        environment.reset(seed=0, options={"goal": (200, 0, -60)})
        for step in range(1, 151):
            if changes and step % 7 == 0:
                environment.set_goal((200, 0, -60 - step / 10))
            *_, terminated, truncated, info = environment.step([100.0, 1.0, 0.4])
            if terminated or truncated:
                break
        lengths.append((info["termination"], info["steps"]))
    assert lengths[0] == lengths[1]
    assert lengths[0][0] == "roll_on"


@needs_vectors
def test_new_goals_for_some_leave_the_others_count_alone() -> None:
    many = gymnasium.make_vec(
        "VVC/Hard-v0", num_envs=3, vectorization_mode="vector_entry_point", autoreset_mode="Disabled"
    )
    many.reset(seed=0, options={"goal": (200, 0, 0)})
    for _ in range(9):
        many.step([LEVEL] * 3)
    observed = many.unwrapped.set_goals([(201, 0, 0)], which=[1])
    np.testing.assert_array_equal(observed["desired_goal"][:, 0], [200, 201, 200])
    np.testing.assert_array_equal(many.step([LEVEL] * 3)[2], [True, False, True])
    for _ in range(8):
        assert not many.step([LEVEL] * 3)[2][1]
    assert many.step([LEVEL] * 3)[2][1]
