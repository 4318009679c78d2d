"""The environments: Gymnasium's rules, the paper's rules, and one behaviour whichever way they are stepped."""

import importlib
import warnings

import gymnasium
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env

import vvc_bench  # noqa: F401  (registers the ids)
from vvc_bench import sim
from vvc_bench.envs import ENVIRONMENT_IDS
from vvc_bench.envs.options import make_fleet, make_spaces
from vvc_bench.sim.task import ALL_EVENTS, Event, Task

IDS = list(ENVIRONMENT_IDS)
MODES = ["guidance", "end_to_end"]
old_gymnasium = not hasattr(gymnasium.vector, "AutoresetMode")
needs_vectors = pytest.mark.skipif(old_gymnasium, reason="the vector environment takes Gymnasium 1.1 or newer")


def near_level(environment, rng):
    """Actions that fly on for a while."""
    if environment.action_space.shape == (3,):
        return np.array([rng.uniform(-40, 40), rng.uniform(0.5, 2.5), rng.uniform()], dtype=np.float32)
    return np.array([rng.uniform(-2, 2), rng.uniform(-3, 0), rng.uniform(-2, 2), rng.uniform()], dtype=np.float32)


@pytest.mark.parametrize("environment_id", IDS)
@pytest.mark.parametrize("control_mode", MODES)
def test_gymnasium_accepts_it(environment_id: str, control_mode: str, capfd: pytest.CaptureFixture) -> None:
    environment = gymnasium.make(environment_id, control_mode=control_mode)
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", message=".*symmetric and normalized space.*")  # degrees are the interface
        check_env(environment.unwrapped, skip_render_check=True)
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize("rules", ["paper", "public_code", "demonstration"])
def test_numbers_stay_finite_where_extreme_states_end_nothing(rules: str) -> None:
    """Full deflections for half a second and more roll some aircraft faster than the time steps can follow."""
    count = 2048
    fleet = make_fleet(count, rules=rules, terminations=("reach_target", "crash", "time_limit"))
    fleet.seed(list(range(count)))
    fleet.begin(np.arange(count))
    bounds = make_spaces(fleet.settings).action
    generator = np.random.default_rng(0)
    actions = np.zeros((count, 3), dtype=np.float32)
    diverged = 0
    for _ in range(400):
        changed = generator.random(count) < 0.05
        actions[changed] = np.where(generator.random((changed.sum(), 3)) < 0.5, bounds.low, bounds.high)
        fleet.step(actions)
        for values in (fleet.observations, fleet.achieved, fleet.report[:, 0], fleet.memories):
            assert np.isfinite(values).all()
        diverged += int((fleet.events == Event.EXTREME_STATE).sum())
        terminated, truncated = fleet.outcomes(fleet.events)
        assert (terminated | truncated)[fleet.events == Event.EXTREME_STATE].all()
        ended = np.flatnonzero(terminated | truncated)
        if ended.size:
            fleet.begin(ended)
    assert diverged > 0


@needs_vectors
@pytest.mark.parametrize("environment_id", IDS)
@pytest.mark.parametrize("control_mode", MODES)
def test_observations_stay_inside_their_spaces(environment_id: str, control_mode: str) -> None:
    environments = gymnasium.make_vec(
        environment_id,
        num_envs=1000,
        vectorization_mode="vector_entry_point",
        vector_kwargs={},
        control_mode=control_mode,
        autoreset_mode="SameStep",
    )
    space = environments.single_observation_space
    low = {name: box.low for name, box in space.items()}
    high = {name: box.high for name, box in space.items()}
    environments.reset(seed=0)
    environments.action_space.seed(0)
    episodes = 0
    for step in range(4000):
        if step % 10 == 0:
            actions = environments.action_space.sample()
        observed, _, terminated, truncated, infos = environments.step(actions)
        episodes += int((terminated | truncated).sum())
        for seen in (observed, infos.get("final_obs", observed)):
            for name, values in seen.items():
                assert values.dtype == np.float32
                assert (values >= low[name]).all()
                assert (values <= high[name]).all()
        if episodes >= 10_000:
            break
    assert episodes >= 10_000


@needs_vectors
@pytest.mark.parametrize("environment_id", IDS)
@pytest.mark.parametrize("mode", ["NextStep", "SameStep"])
def test_one_among_many_flies_as_it_would_alone(environment_id: str, mode: str) -> None:
    count = 5
    rng = np.random.default_rng(1)
    many = gymnasium.make_vec(
        environment_id, num_envs=count, vectorization_mode="vector_entry_point", autoreset_mode=mode
    )
    singles = [gymnasium.make(environment_id) for _ in range(count)]
    together, _ = many.reset(seed=7)
    alone = [single.reset(seed=7 + i)[0] for i, single in enumerate(singles)]
    ended = np.zeros(count, dtype=bool)
    seen_ends = 0
    for _ in range(600):
        actions = np.stack([near_level(single, rng) for single in singles])
        together, rewards, terminated, truncated, infos = many.step(actions)
        for i, single in enumerate(singles):
            if ended[i] and mode == "NextStep":
                alone[i], _ = single.reset()
                expected = (0.0, False, False)
            else:
                alone[i], *expected, info = single.step(actions[i])
                assert infos["events"][i] == info["events"]
                assert infos["direction_error_deg"][i] == info["direction_error_deg"]
            assert (rewards[i], terminated[i], truncated[i]) == tuple(expected)
            ended[i] = terminated[i] or truncated[i]
            if ended[i] and mode == "SameStep":
                for name, values in alone[i].items():
                    np.testing.assert_array_equal(infos["final_obs"][name][i], values)
                alone[i], _ = single.reset()
            for name, values in alone[i].items():
                np.testing.assert_array_equal(together[name][i], values)
        seen_ends += int(ended.sum())
    assert seen_ends >= count


def test_observations_share_no_memory() -> None:
    environment = gymnasium.make("VVC/Hard-v0")
    first, _ = environment.reset(seed=0)
    kept = {name: values.copy() for name, values in first.items()}
    second, *_ = environment.step(environment.action_space.sample())
    for name, values in first.items():
        np.testing.assert_array_equal(values, kept[name])
        assert not np.shares_memory(values, second[name])


def test_same_seed_same_flight() -> None:
    flights = []
    for _ in range(2):
        environment = gymnasium.make("VVC/Hard-v0")
        observed, _ = environment.reset(seed=3)
        flight = [observed["desired_goal"]]
        for _ in range(30):
            observed, *_ = environment.step([30.0, 2.0, 0.8])
            flight.append(observed["observation"])
        flights.append(np.concatenate(flight))
    np.testing.assert_array_equal(*flights)


@needs_vectors
@pytest.mark.parametrize(
    ("name", "low", "high"),
    [
        ("VVC/Normal-v0", (150, -10, -30), (250, 10, 30)),
        ("VVC/Medium-v0", (150, -30, -60), (250, 30, 60)),
        ("VVC/Hard-v0", (100, -85, -170), (300, 85, 170)),
        ("VVC/FlyCraft-v0", (100, -90, -180), (300, 90, 180)),
    ],
)
def test_goals_fill_the_papers_boxes(name: str, low: tuple, high: tuple) -> None:
    environments = gymnasium.make_vec(name, num_envs=4000, vectorization_mode="vector_entry_point")
    goals = environments.reset(seed=0)[0]["desired_goal"].astype(float)
    width = np.subtract(high, low)
    assert (goals >= np.array(low) - 1e-4).all()
    assert (goals <= np.array(high) + 1e-4).all()
    np.testing.assert_allclose(goals.mean(axis=0), np.add(low, high) / 2, atol=0.03 * width.max())
    np.testing.assert_allclose(goals.std(axis=0), width / np.sqrt(12), rtol=0.05)


def test_table_6() -> None:
    """The paper's Table 6, from the one place where its numbers stand."""
    task = gymnasium.make("VVC/Hard-v0").unwrapped.task
    columns = sim.columns(Task).items()
    outside = {name: value * field.unit.scale for (name, field), value in zip(columns, task, strict=True)}
    expected = {
        "speed_band_mps": 10,
        "direction_band_deg": 3,
        "reach_steps": 10,
        "step_limit": 400,
        "speed_weight": 0.5,
        "direction_weight": 0.5,
        "speed_scale_mps": 100,
        "direction_scale_deg": 180,
        "exponent": 0.5,
        "discount": 0.995,
        "least_altitude_m": 0,
        "largest_speed_mps": 400,
        "largest_roll_rate_degps": 300,
        "move_away_steps": 20,
        "largest_roll_on_deg": 720,
        "steep_bank_deg": 60,
        "least_load_factor_g": 0,
        "negative_load_steps": 20,
    }
    assert {name: pytest.approx(value) for name, value in expected.items()} == {
        name: outside[name] for name in expected
    }


def fly_until_the_end(environment: gymnasium.Env, action: object, goal: object = None) -> tuple[list, dict]:
    options = None if goal is None else {"goal": goal}
    environment.reset(seed=0, options=options)
    rewards = []
    for _ in range(1000):
        _, reward, terminated, truncated, info = environment.step(action)
        rewards.append(reward)
        if terminated or truncated:
            return rewards, info | {"terminated": terminated, "truncated": truncated}
    raise AssertionError("it never ends")


LEVEL = [0.0, 1.0, 0.154]


def test_reaching_terminates_with_reward_0_after_the_steps_held() -> None:
    for held in (1, 10, 30):
        environment = gymnasium.make("VVC/Hard-v0", reach_steps=held)
        rewards, info = fly_until_the_end(environment, LEVEL, (200, 0, 0))
        assert (info["terminated"], info["truncated"], info["is_success"]) == (True, False, True)
        assert (info["termination"], info["steps"]) == ("reach_target", held)
        assert rewards[-1] == 0.0
        assert all(reward < 0 for reward in rewards[:-1])


def test_time_truncates_after_exactly_the_limit_and_is_not_punished() -> None:
    environment = gymnasium.make("VVC/Hard-v0", terminations=("reach_target", "time_limit"), step_limit=50)
    rewards, info = fly_until_the_end(environment, LEVEL, (200, 0, 90))
    assert (info["terminated"], info["truncated"], info["termination"]) == (False, True, "time_limit")
    assert len(rewards) == 50
    assert min(rewards) > -1.0


@pytest.mark.parametrize(
    ("event", "action", "goal"),
    [
        ("crash", [0.0, -1.0, 1.0], (200, 0, 90)),
        ("extreme_state", [0.0, 1.0, 1.0], (200, 0, 90)),
        ("move_away", [40.0, 2.0, 0.3], (200, 0, -90)),
        ("roll_on", [150.0, 1.0, 0.3], (200, 0, 90)),
        ("negative_load_banked", [60.0, -1.5, 0.3], (200, 0, 90)),
    ],
)
def test_failures_terminate_with_the_penalty_alone(event: str, action: list, goal: tuple) -> None:
    only = {"terminations": (event, "time_limit"), "step_limit": 2000, "largest_speed_mps": 230}
    for penalty, discount in (("pessimistic", 0.995), ("constant", 0.995), ("pessimistic", 1.0)):
        environment = gymnasium.make("VVC/Hard-v0", penalty=penalty, discount=discount, **only)
        if event == "negative_load_banked":
            action = [60.0 if environment.unwrapped.state.roll < 1.5 else 0.0, *action[1:]]
        rewards, info = fly_until_the_end(environment, action, goal)
        assert (info["terminated"], info["truncated"], info["termination"]) == (True, False, event)
        assert not info["is_success"]
        left = 2000 - len(rewards)
        expected = -left if discount == 1.0 else -(1 - 0.995**left) / 0.005
        assert rewards[-1] == pytest.approx(-1.0 if penalty == "constant" else expected)
        assert min(rewards[:-1]) >= -1.0


def test_switched_off_terminations_do_not_end_an_episode() -> None:
    environment = gymnasium.make("VVC/Hard-v0", terminations=("time_limit",))
    rewards, info = fly_until_the_end(environment, [0.0, -1.0, 1.0], (200, 0, 90))
    assert len(rewards) == 400
    assert Event(info["events"]) == Event.TIME_LIMIT


def test_dense_reward_is_equation_1() -> None:
    environment = gymnasium.make("VVC/Hard-v0")
    environment.reset(seed=0, options={"goal": (260, 0, 90)})
    observed, reward, *_ = environment.step(LEVEL)
    speed = float(observed["achieved_goal"][0])
    expected = -(0.5 * np.sqrt((260 - speed) / 100) + 0.5 * np.sqrt(90 / 180))
    assert reward == pytest.approx(expected, abs=1e-6)


@pytest.mark.parametrize("kind", ["dense", "sparse", "distance"])
@pytest.mark.parametrize("exponent", [0.5, 1.0])
def test_relabelling_gives_the_rewards_of_the_steps(kind: str, exponent: float) -> None:
    environment = gymnasium.make("VVC/Hard-v0", reward=kind, reach_steps=1, exponent=exponent).unwrapped
    rng = np.random.default_rng(0)
    achieved, desired, rewards = [], [], []
    for episode in range(20):
        goal = (200 + rng.uniform(-15, 15), rng.uniform(-5, 5), rng.uniform(-5, 5))
        environment.reset(seed=episode, options={"goal": goal})
        for _ in range(40):
            observed, reward, terminated, truncated, info = environment.step(near_level(environment, rng))
            if Event(info["events"]) & ~(Event.REACH_TARGET | Event.TIME_LIMIT):
                break
            achieved.append(observed["achieved_goal"])
            desired.append(observed["desired_goal"])
            inside = environment.compute_terminated(achieved[-1], desired[-1])
            assert inside == info["is_success"]
            if kind == "dense" and inside:  # the step itself is worth 0: reached
                reward = environment.compute_reward(achieved[-1], desired[-1])
            rewards.append(reward)
            if terminated or truncated:
                break
    batch = environment.compute_reward(np.array(achieved), np.array(desired), [{}] * len(achieved))
    np.testing.assert_array_equal(batch, rewards)
    assert batch.shape == (len(rewards),)
    assert not environment.compute_truncated(np.array(achieved), np.array(desired)).any()


def test_a_new_goal_starts_the_count_anew() -> None:
    environment = gymnasium.make("VVC/Hard-v0").unwrapped
    environment.reset(seed=0, options={"goal": (200, 0, 0)})
    for _ in range(9):
        environment.step(LEVEL)
    observed = environment.set_goal((201, 0, 0))
    np.testing.assert_array_equal(observed["desired_goal"], [201, 0, 0])
    for step in range(1, 11):
        _, _, terminated, _, info = environment.step(LEVEL)
        assert terminated == (step == 10)
    assert info["steps"] == 19


@needs_vectors
def test_goals_may_be_replaced_while_training() -> None:
    environments = gymnasium.make_vec(
        "VVC/Hard-v0", num_envs=3, vectorization_mode="vector_entry_point", goals=[(150, 0, 0)]
    )
    assert (environments.reset(seed=0)[0]["desired_goal"] == [150, 0, 0]).all()
    environments.goals = lambda generator: (generator.choice([210.0, 220.0]), 5.0, 5.0)
    assert set(environments.reset(seed=0)[0]["desired_goal"][:, 0]) <= {210.0, 220.0}


@pytest.mark.skipif(not old_gymnasium, reason="the vector environment is there")
def test_an_old_gymnasium_is_told_apart() -> None:
    with pytest.raises(ImportError, match=f"takes Gymnasium 1.1 or newer, this is {gymnasium.__version__}: upgrade it"):
        importlib.import_module("vvc_bench.envs.vector")


def test_start_from_any_state() -> None:
    environment = gymnasium.make("VVC/Hard-v0").unwrapped
    settings = environment.fleet.settings
    state = sim.start_from(settings, airspeed_mps=250, altitude_m=3000, roll_deg=45, yaw_deg=90)
    observed, _ = environment.reset(options={"state": state, "goal": (250, 0, 90)})
    assert observed["observation"][[0, 2, 3, 7]] == pytest.approx([45, 90, 250, 3000], abs=1e-3)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"task": "easy"}, "unknown task 'easy'; known are normal"),
        ({"reach": 3}, "unknown task field 'reach'; known are speed_band_mps"),
        ({"reach_steps": 0}, r"reach_steps must lie in \[1, 1000\], got 0"),
        ({"reach_steps": 1.5}, "reach_steps must be a whole number"),
        ({"reward": "shaped"}, "reward must be one of dense, sparse, distance, got 'shaped'"),
        ({"terminations": ("landing",)}, "terminations must be one of reach_target, crash"),
        ({"direction_band_deg": "wide"}, "direction_band_deg must be a number"),
        ({"goals": [(200, 95, 0)]}, r"goal path_angle_deg must be a finite number in \[-90, 90\], got 95"),
        ({"conditions": {"wind": 3}}, "unknown condition 'wind'"),
        ({"render_mode": "ascii"}, "render_mode must be one of"),
    ],
)
def test_impossible_environments_are_refused(arguments: dict, message: str) -> None:
    from vvc_bench.envs.environment import VelocityVectorEnv

    with pytest.raises(ValueError, match=message):
        VelocityVectorEnv(**arguments)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"goals": (200, 0, 0)}, "unknown reset option 'goals'"),
        ({"goal": (200, 0)}, "a goal is"),
        ({"goal": (200, np.nan, 0)}, "goal path_angle_deg must be a finite number"),
        ({"state": np.zeros(3)}, "must be a row of 42 values"),
    ],
)
def test_impossible_resets_are_refused(options: dict, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        gymnasium.make("VVC/Hard-v0").reset(options=options)


def test_frames_show_the_episode() -> None:
    environment = gymnasium.make("VVC/Hard-v0", render_mode="rgb_array")
    environment.reset(seed=0, options={"goal": (220, 20, -60)})
    first = environment.render()
    for _ in range(20):
        environment.step([-60.0, 2.0, 0.9])
    second = environment.render()
    for frame in (first, second):
        assert (frame.shape, frame.dtype) == ((540, 960, 3), np.uint8)
    assert (first != second).mean() > 0.01
    flight = environment.unwrapped.flight
    assert flight.states.shape[0] == 21
    again = sim.step(flight.states[0], flight.commands[0], flight.settings)
    np.testing.assert_array_equal(again, flight.states[1])
    with pytest.raises(ValueError, match="render_mode"):
        gymnasium.make("VVC/Hard-v0").unwrapped.render()


def test_bad_actions_are_refused_and_nothing_changes() -> None:
    environment = gymnasium.make("VVC/Hard-v0").unwrapped
    environment.reset(seed=0)
    before = environment.state
    for action, message in (([0, np.nan, 0], "'load_factor_g' of aircraft 0 is NaN"), ([0, 1], "must have shape")):
        with pytest.raises(ValueError, match=message):
            environment.step(action)
    assert environment.state == before


def test_all_events_have_a_bit_of_their_own() -> None:
    assert sum(1 << i for i in range(len(Event))) == ALL_EVENTS
