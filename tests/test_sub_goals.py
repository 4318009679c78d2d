"""`VVC/TurnClimb-v0`: goals one after another within an episode, for one aircraft and for many alike."""

import warnings

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from numpy.typing import NDArray
from test_environments import LEVEL, MODES, needs_vectors

import vvc_bench  # noqa: F401  (registers the ids)
from vvc_bench import sim
from vvc_bench.envs import SUB_GOALS_ID
from vvc_bench.envs.sub_goals import TURN_CLIMB
from vvc_bench.experts import WEIGHT_COMPENSATED, pid_commands
from vvc_bench.sim.task import Event

NEAR = ((200, 0, 8), (215, 0, 8), (215, 4, 8))
"""Sub-goals that are reached in a few seconds each."""
SCALE = np.array([field.unit.scale for field in sim.columns(sim.GuidanceCommand).values()])


def expert_actions(environments: gymnasium.Env | gymnasium.vector.VectorEnv) -> NDArray:
    """What the guidance law does for every aircraft, shape (N, 3)."""
    fleet = environments.unwrapped.fleet
    return np.float32(pid_commands(fleet.rows, fleet.goals, WEIGHT_COMPENSATED) * SCALE)


def make_many(count: int, **options: object) -> gymnasium.vector.VectorEnv:
    return gymnasium.make_vec(SUB_GOALS_ID, num_envs=count, vectorization_mode="vector_entry_point", **options)


@pytest.mark.parametrize("control_mode", MODES)
def test_gymnasium_accepts_it(control_mode: str, capfd: pytest.CaptureFixture) -> None:
    environment = gymnasium.make(SUB_GOALS_ID, control_mode=control_mode)
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message=".*symmetric and normalized space.*")  # degrees are the interface
        check_env(environment.unwrapped, skip_render_check=True)
    assert capfd.readouterr() == ("", "")


def test_sub_goals_follow_one_another() -> None:
    environment = gymnasium.make(SUB_GOALS_ID)
    observed, info = environment.reset(seed=0)
    assert info["sub_goals_reached"] == 0
    wanted, reached, rewards = [tuple(observed["desired_goal"])], [0], []
    for _ in range(400):
        observed, reward, terminated, truncated, info = environment.step(expert_actions(environment)[0])
        if tuple(observed["desired_goal"]) != wanted[-1]:
            wanted.append(tuple(observed["desired_goal"]))
        reached.append(info["sub_goals_reached"])
        rewards.append(reward)
        assert info["is_success"] == terminated == (info["sub_goals_reached"] == len(TURN_CLIMB))
        assert bool(info["events"]) == terminated
        if terminated or truncated:
            break
    assert wanted == list(TURN_CLIMB)
    assert (terminated, truncated, info["termination"]) == (True, False, "reach_target")
    assert set(np.diff(reached)) == {0, 1}
    np.testing.assert_array_equal(np.diff(reached) == 1, np.array(rewards) == 0.0)


def test_each_is_held_anew_and_the_step_limit_is_the_whole_episodes() -> None:
    ahead = (200, 0, 0)
    environment = gymnasium.make(SUB_GOALS_ID, sub_goals=(ahead, ahead, (200, 0, 30)), reach_steps=5, step_limit=10)
    environment.reset(seed=0)
    for step in range(1, 11):
        observed, reward, terminated, truncated, info = environment.step(LEVEL)
        assert info["sub_goals_reached"] == step // 5
        assert (reward == 0.0) == (step % 5 == 0)
        assert (terminated, truncated, info["is_success"]) == (False, step == 10, False)
    assert Event(info["events"]) == Event.TIME_LIMIT
    assert (info["termination"], info["steps"]) == ("time_limit", 10)
    np.testing.assert_array_equal(observed["desired_goal"], [200, 0, 30])


def test_a_failure_ends_it_and_the_next_episode_begins_with_the_first() -> None:
    environment = gymnasium.make(SUB_GOALS_ID, sub_goals=((200, 0, 0), (200, 0, 90)), altitude_m=500)
    environment.reset(seed=0)
    for step in range(400):
        *_, terminated, truncated, info = environment.step(LEVEL if step < 10 else [0.0, -1.0, 1.0])
        if terminated or truncated:
            break
    assert (terminated, truncated, info["is_success"]) == (True, False, False)
    assert (info["termination"], info["sub_goals_reached"]) == ("crash", 1)
    observed, info = environment.reset()
    assert info["sub_goals_reached"] == 0
    np.testing.assert_array_equal(observed["desired_goal"], [200, 0, 0])


def assert_row(rows: dict, i: int, one: dict) -> None:
    """What many hand out for aircraft i is what one alone does; names of terminations are for one alone."""
    for name, value in one.items():
        if name != "termination":
            np.testing.assert_array_equal(rows[name][i], value, err_msg=name)


def step_alone(
    environment: gymnasium.Env, action: NDArray, ended: bool, mode: str
) -> tuple[dict, tuple, dict, dict | None]:
    """A step as a vector environment's mode has it: observation, outcome, info; the last observation if it ended."""
    if ended and mode == "NextStep":
        return environment.reset()[0], (0.0, False, False), {"events": 0, "sub_goals_reached": 0}, None
    observed, *outcome, info = environment.step(action)
    if not (outcome[1] or outcome[2]):
        return observed, tuple(outcome), info, None
    return environment.reset()[0] if mode == "SameStep" else observed, tuple(outcome), info, observed


@needs_vectors
@pytest.mark.parametrize("mode", ["NextStep", "SameStep", "Disabled"])
@pytest.mark.parametrize("rules", ["paper", "public_code"])
def test_one_among_many_flies_as_it_would_alone(mode: str, rules: str) -> None:
    count, rng = 6, np.random.default_rng(3)
    options = {"sub_goals": NEAR, "step_limit": 110, "reach_steps": 4, "rules": rules}
    many = make_many(count, autoreset_mode=mode, **options)
    singles = [gymnasium.make(SUB_GOALS_ID, **options) for _ in range(count)]
    many.reset(seed=0)
    for i, single in enumerate(singles):
        single.reset(seed=i)
    ended, ends = np.zeros(count, dtype=bool), set()
    for _ in range(500):
        actions = expert_actions(many)
        actions[4, 2] = 0.16  # too little for the second speed
        actions[5] = [170, 1, 0.2]  # rolls on and on
        actions += np.float32(rng.normal(0, [3, 0.1, 0.05], actions.shape) * np.arange(count)[:, None])
        together, *outcomes, infos = many.step(actions)
        for i, single in enumerate(singles):
            observed, outcome, info, last = step_alone(single, actions[i], ended[i], mode)
            assert tuple(part[i] for part in outcomes) == outcome
            assert_row(together, i, observed)
            assert_row(infos, i, info)
            ended[i] = last is not None
            if ended[i]:
                ends.add((info["termination"], info["sub_goals_reached"]))
            if ended[i] and mode == "SameStep":
                assert_row(infos["final_obs"], i, last)
                assert_row(infos["final_info"], i, info)
        if mode == "Disabled" and ended.any():
            many.reset(options={"reset_mask": ended})
            for i in np.flatnonzero(ended):
                singles[i].reset()
    assert infos["_sub_goals_reached"].all()
    assert {("reach_target", 3), ("roll_on", 0), ("time_limit", 1)} <= ends


@needs_vectors
def test_thousands_turn_accelerate_and_climb() -> None:
    many = make_many(1000, autoreset_mode="Disabled")
    many.reset(seed=0)
    offsets = np.random.default_rng(0).normal(0, [2, 0.05, 0.02], (1000, 3)).astype(np.float32)
    ended = np.zeros(1000, dtype=bool)
    success = ended.copy()
    while not ended.all():
        *_, terminated, truncated, infos = many.step(expert_actions(many) + offsets)
        success |= infos["is_success"] & ~ended
        ended |= terminated | truncated
    assert success.mean() > 0.5
    assert (infos["sub_goals_reached"][success] == len(TURN_CLIMB)).all()


@pytest.mark.parametrize(
    ("arguments", "error", "message"),
    [
        ({"sub_goals": []}, ValueError, "a goal is"),
        ({"sub_goals": [(200, 95, 0)]}, ValueError, "goal path_angle_deg must be"),
        ({"goals": [(200, 0, 0)]}, TypeError, "'goals'"),
    ],
)
@pytest.mark.parametrize("make", [gymnasium.make, pytest.param(lambda _, **k: make_many(2, **k), marks=needs_vectors)])
def test_impossible_sub_goals_are_refused(make: object, arguments: dict, error: type, message: str) -> None:
    with pytest.raises(error, match=message):
        make(SUB_GOALS_ID, **arguments)


def test_a_goal_of_ones_own_is_refused() -> None:
    with pytest.raises(ValueError, match="its sub-goals"):
        gymnasium.make(SUB_GOALS_ID).reset(options={"goal": (200, 0, 0)})
