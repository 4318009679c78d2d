"""Many flights at once: the same as one at a time in the environment, and again from their actions."""

import gymnasium
import numpy as np
import pytest

import vvc_bench
from vvc_bench import sim
from vvc_bench.experts import APPENDIX_C, WEIGHT_COMPENSATED, Goal, pid_command
from vvc_bench.goals import SCALE, grid
from vvc_bench.rollout import Episodes, Scenario, concatenate, fly_law, replay
from vvc_bench.rollout.episodes import PER_EPISODE, PER_TRANSITION
from vvc_bench.sim.fields import Conditions, GuidanceCommand, Observation, columns, field_array
from vvc_bench.sim.task import Event
from vvc_bench.tasks import TASKS, make_task

GOALS = grid([160, 200, 260], [-20, 0, 15], [-60, -10, 0, 45]).goals
DEMONSTRATION = {"rules": "demonstration", "direction_band_deg": 1, "step_limit": 600}
ENDINGS = ("reach_target", "crash", "time_limit")
TASK = make_task(TASKS["hard"].task, terminations=ENDINGS, **DEMONSTRATION)
SCENARIO = Scenario(TASK)


@pytest.fixture(scope="module")
def flown() -> Episodes:
    return fly_law(SCENARIO, GOALS).episodes


def same(first: Episodes, second: Episodes) -> bool:
    names = ("offsets", *PER_EPISODE, *PER_TRANSITION)
    return all(np.array_equal(getattr(first, name), getattr(second, name)) for name in names)


def law(observed: dict[str, np.ndarray]) -> np.ndarray:
    """The expert as anybody's policy: from what is observed to an action, in outside units."""
    seen = Observation(*(observed["observation"].astype(float) / field_array(Observation, "scale")))
    goal = Goal(*(observed["desired_goal"].astype(float) / SCALE))
    return np.array(pid_command(seen, goal, APPENDIX_C)) * field_array(GuidanceCommand, "scale")


def test_the_expert_is_a_policy_of_the_environment(flown: Episodes) -> None:
    """Transition by transition, bit for bit: observations, actions, rewards, events."""
    environment = gymnasium.make("VVC/Hard-v0", terminations=ENDINGS, **DEMONSTRATION)
    assert len(flown) > 10
    for e in (0, len(flown) // 2, len(flown) - 1):
        observed, _ = environment.reset(options={"goal": flown.goals[e]})
        for t in range(flown.offsets[e], flown.offsets[e + 1]):
            np.testing.assert_array_equal(observed["observation"], flown.observations[t])
            action = law(observed).astype(np.float32)
            np.testing.assert_array_equal(action, flown.actions[t])
            observed, reward, terminated, truncated, info = environment.step(action)
            assert flown.rewards[t] == np.float32(reward)
            assert flown.events[t] == info["events"]
            assert (terminated, truncated) == (flown.ends[0][t], flown.ends[1][t])
            assert flown.load_factors[t] == np.float32(info["load_factor_g"])
            state = environment.unwrapped.state
            assert flown.deflections[t, 3] == np.float32(state.throttle)
        np.testing.assert_array_equal(observed["observation"], flown.final_observations[e])
        assert info["is_success"]


def test_kept_flights_meet_the_criterion_of_the_paper(flown: Episodes) -> None:
    """Means over the last ten reports, the start not among them, and not a step earlier."""
    speed, path_angle, azimuth = (list(columns(Observation)).index(name) for name in vvc_bench.goals.GOAL_COLUMNS)
    after = flown.next_observations
    for e in range(len(flown)):
        reports = after[flown.offsets[e] : flown.offsets[e + 1]].astype(float)
        errors = np.abs(reports[:, [speed, path_angle, azimuth]] - flown.goals[e])
        means = np.array([errors[t - 9 : t + 1].mean(axis=0) for t in range(9, len(errors))])
        inside = (means < [10, 1, 1]).all(axis=1)
        assert inside[-1]
        assert not inside[:-1].any()
    assert (flown.lengths >= 10).all()


def test_nothing_depends_on_threads_or_company(flown: Episodes) -> None:
    assert same(fly_law(SCENARIO, GOALS, threads=1).episodes, flown)
    apart = [fly_law(SCENARIO, part).episodes for part in np.array_split(GOALS, 5)]
    assert same(concatenate(apart), flown)


def test_recorded_actions_fly_the_same_flights(flown: Episodes) -> None:
    again = replay(
        SCENARIO, flown.goals, flown.actions, flown.offsets, sources=flown.sources, starts=np.array(flown.starts)
    )
    assert same(again, flown)


def test_actions_after_the_end_are_cut_off(flown: Episodes) -> None:
    padded = [np.concatenate([flown.select([e]).actions, np.zeros((5, 3), np.float32)]) for e in range(len(flown))]
    offsets = np.concatenate([[0], np.cumsum([len(actions) for actions in padded])])
    again = replay(SCENARIO, flown.goals, np.concatenate(padded), offsets, sources="pid")
    assert same(again, flown)


def test_too_few_actions_end_in_no_event(flown: Episodes) -> None:
    first = flown.select([0])
    short = replay(SCENARIO, first.goals, first.actions[:-1], np.array([0, len(first.actions) - 1]))
    assert short.final_events.tolist() == [0]
    assert not short.reached.any()


def test_selection_and_concatenation_are_inverse(flown: Episodes) -> None:
    order = np.random.default_rng(0).permutation(len(flown))
    shuffled = flown.select(order)
    np.testing.assert_array_equal(shuffled.lengths, flown.lengths[order])
    assert same(concatenate([flown.select([e]) for e in range(len(flown))]), flown)
    assert same(shuffled.select(np.argsort(order)), flown)
    assert same(flown.select(flown.lengths > 100), flown.select(np.flatnonzero(flown.lengths > 100)))


def test_outcomes_cover_every_goal() -> None:
    flown = fly_law(SCENARIO, [[200, 0, 5], [290, 80, 0], [100, -85, 170]])
    assert len(flown.last_events) == 3
    assert flown.last_events[0] == Event.REACH_TARGET
    assert len(flown.episodes) == int((flown.last_events & Event.REACH_TARGET).astype(bool).sum())


def test_weather_comes_from_the_episodes_seed() -> None:
    windy = Scenario(TASK, conditions=Conditions(gust_intensity=1.0, sensor_noise=1.0))
    goals = [[200, 0, 5]] * 3
    flown = fly_law(windy, goals, WEIGHT_COMPENSATED, seeds=[1, 2, 1]).episodes
    assert len(flown) == 3
    first, second, third = (flown.select([e]) for e in range(3))
    np.testing.assert_array_equal(first.observations, third.observations)
    assert not np.array_equal(first.observations[:10], second.observations[:10])
    again = replay(windy, flown.goals, flown.actions, flown.offsets, seeds=flown.seeds, sources="pid")
    assert same(again, flown)


@pytest.mark.parametrize("name", TASKS)
def test_a_scenario_survives_the_trip_to_json(name: str) -> None:
    scenario = Scenario(
        make_task(TASKS[name].task, direction_band_deg=1.7),
        sim.Settings("end_to_end", "accurate", 20.0),
        altitude_m=4000.0,
        conditions=Conditions(wind_north=3.0, actuator_rate_limit=1.0),
    )
    document = scenario.to_json()
    assert document["task"]["direction_band_deg"] == 1.7
    assert Scenario.from_json(document) == scenario
    with pytest.raises(ValueError, match="unknown field 'wind'"):
        Scenario.from_json(document | {"conditions": {"wind": 1.0}})


def test_bad_input_is_named(flown: Episodes) -> None:
    with pytest.raises(ValueError, match="offsets must rise from 0"):
        replay(SCENARIO, flown.goals, flown.actions, flown.offsets[:-1])
    with pytest.raises(ValueError, match="actions must be float32"):
        replay(SCENARIO, flown.goals, flown.actions[:, :2], flown.offsets)
    broken = flown.actions.copy()
    broken[3, 1] = np.nan
    with pytest.raises(ValueError, match="action 3 is NaN"):
        replay(SCENARIO, flown.goals, broken, flown.offsets)
    with pytest.raises(ValueError, match="control_mode='guidance'"):
        fly_law(Scenario(TASK, sim.Settings("end_to_end")), GOALS)
