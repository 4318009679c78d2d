"""Stable-Baselines3: its checker accepts the environments, its learners fly them, and the flights are the same."""

import gymnasium
import numpy as np
import pytest
from test_environments import IDS, LEVEL, MODES, near_level, old_gymnasium

pytest.importorskip("stable_baselines3", reason="Stable-Baselines3 is not installed: pip install vvc-bench[train]")

from stable_baselines3 import PPO, SAC, HerReplayBuffer
from stable_baselines3.common.env_checker import check_env
from stable_baselines3.common.evaluation import evaluate_policy
from stable_baselines3.common.vec_env import VecMonitor, VecNormalize

from vvc_bench import sim
from vvc_bench.envs.stable_baselines import VelocityVectorVecEnv

SHORT = {"step_limit": 60}
GOAL_IS_AHEAD = {"goals": [(200, 0, 0)], "reach_steps": 3}


class FliesLevel:
    """A policy, as far as `evaluate_policy` needs one."""

    def predict(self, observations: dict, **_: object) -> tuple[np.ndarray, None]:
        return np.tile(np.float32(LEVEL), (len(observations["observation"]), 1)), None


@pytest.mark.parametrize("environment_id", IDS)
@pytest.mark.parametrize("control_mode", MODES)
@pytest.mark.filterwarnings("ignore:.*symmetric and normalized Box action space")  # degrees are the interface
def test_its_checker_accepts_the_single_environment(environment_id: str, control_mode: str) -> None:
    check_env(gymnasium.make(environment_id, control_mode=control_mode))


@pytest.mark.parametrize("environment_id", IDS)
def test_a_flight_is_the_same_through_either_interface(environment_id: str) -> None:
    count = 5
    rng = np.random.default_rng(1)
    many = VelocityVectorVecEnv(environment_id, count, seed=7, **SHORT)
    singles = [gymnasium.make(environment_id, **SHORT) for _ in range(count)]
    observed = many.reset()
    alone = [single.reset(seed=7 + i)[0] for i, single in enumerate(singles)]
    returns = np.zeros(count)
    lengths, only_truncated = [], 0
    for _ in range(300):
        for name, values in observed.items():
            assert values.dtype == np.float32
            np.testing.assert_array_equal(values, [each[name] for each in alone])
        actions = np.stack([near_level(single, rng) for single in singles])
        observed, rewards, dones, infos = many.step(actions)
        for i, single in enumerate(singles):
            alone[i], reward, terminated, truncated, info = single.step(actions[i])
            returns[i] += reward
            assert (rewards[i], dones[i]) == (np.float32(reward), terminated or truncated)
            if not dones[i]:
                assert infos[i] == {}
                continue
            assert infos[i].items() >= info.items()
            assert infos[i]["TimeLimit.truncated"] == (truncated and not terminated)
            assert infos[i]["episode"]["r"] == pytest.approx(returns[i])
            assert infos[i]["episode"]["l"] == info["steps"]
            np.testing.assert_equal(infos[i]["terminal_observation"], alone[i])
            lengths.append(infos[i]["episode"]["l"])
            only_truncated += infos[i]["TimeLimit.truncated"]
            returns[i] = 0.0
            alone[i], _ = single.reset()
    assert len(lengths) > 3 * count
    assert (only_truncated > 0) == (environment_id != "VVC/FlyCraft-v0")  # where time terminates too


@pytest.mark.skipif(old_gymnasium, reason="the vector environment takes Gymnasium 1.1 or newer")
@pytest.mark.parametrize("control_mode", MODES)
def test_a_flight_is_the_same_in_gymnasiums_vector_environment(control_mode: str) -> None:
    arguments = {"control_mode": control_mode, "step_limit": 60}
    ours = VelocityVectorVecEnv("VVC/Hard-v0", 50, seed=3, **arguments)
    theirs = gymnasium.make_vec(
        "VVC/Hard-v0",
        num_envs=50,
        vectorization_mode="vector_entry_point",
        autoreset_mode="SameStep",
        **arguments,
    )
    theirs.action_space.seed(0)
    np.testing.assert_equal(ours.reset(), theirs.reset(seed=3)[0])
    ends = 0
    for _ in range(200):
        actions = theirs.action_space.sample()
        observed, rewards, dones, infos = ours.step(actions)
        expected, expected_rewards, terminated, truncated, expected_infos = theirs.step(actions)
        np.testing.assert_equal(observed, expected)
        np.testing.assert_array_equal(rewards, expected_rewards.astype(np.float32))
        np.testing.assert_array_equal(dones, terminated | truncated)
        for i in np.flatnonzero(dones):
            last = {name: values[i] for name, values in expected_infos["final_obs"].items()}
            np.testing.assert_equal(infos[i]["terminal_observation"], last)
            ends += 1
    assert ends > 100


def test_what_was_handed_out_stays_as_it_was() -> None:
    environments = VelocityVectorVecEnv("VVC/Hard-v0", 3, seed=0, **GOAL_IS_AHEAD)
    actions = np.tile(np.float32(LEVEL), (3, 1))
    environments.reset()
    handed_out = [environments.step(actions) for _ in range(3)]
    kept = [
        (np.copy(observed["observation"]), rewards.copy(), dones.copy()) for observed, rewards, dones, _ in handed_out
    ]
    last = {name: values.copy() for name, values in handed_out[-1][3][0]["terminal_observation"].items()}
    for _ in range(5):
        *_, infos = environments.step(actions)
        infos[0]["mine"] = True  # as wrappers do
        assert "mine" not in infos[1]
    for (observed, *others, _), (observation, *expected) in zip(handed_out, kept, strict=True):
        np.testing.assert_array_equal(observed["observation"], observation)
        np.testing.assert_equal(others, expected)
    np.testing.assert_equal(handed_out[-1][3][0]["terminal_observation"], last)


def test_hindsight_relabelling_learns_and_gives_the_rewards_of_the_environment() -> None:
    goal = (240.0, 20.0, 60.0)
    environments = VelocityVectorVecEnv("VVC/Normal-v0", 4, reward="distance", step_limit=20, goals=[goal])
    model = SAC(
        "MultiInputPolicy",
        environments,
        replay_buffer_class=HerReplayBuffer,
        replay_buffer_kwargs={"n_sampled_goal": 4, "goal_selection_strategy": "future"},
        learning_starts=200,
        batch_size=32,
        device="cpu",
        seed=0,
    ).learn(600)
    assert model.num_timesteps == 600
    assert len(model.ep_info_buffer) == 4 * (600 // 4 // 20)
    batch = model.replay_buffer.sample(500)
    achieved, desired = (batch.next_observations[name].numpy() for name in ("achieved_goal", "desired_goal"))
    relabelled = (desired != np.float32(goal)).any(axis=1)
    assert 0.6 < relabelled.mean() < 0.95
    expected = gymnasium.make("VVC/Normal-v0", reward="distance").unwrapped.compute_reward(achieved, desired)
    np.testing.assert_array_equal(batch.rewards.numpy()[:, 0], expected.astype(np.float32))


def test_ppo_learns_and_knows_how_episodes_went() -> None:
    environments = VelocityVectorVecEnv("VVC/Normal-v0", 8, step_limit=20)
    model = PPO("MultiInputPolicy", environments, n_steps=32, batch_size=64, n_epochs=1, device="cpu", seed=0).learn(
        512
    )
    assert model.num_timesteps == 512
    assert {each["l"] for each in model.ep_info_buffer} <= set(range(1, 21))
    assert len(model.ep_info_buffer) >= 8 * (512 // 8 // 20)


def test_evaluation_sees_the_rewards_under_a_normalising_wrapper() -> None:
    single = gymnasium.make("VVC/Hard-v0", **GOAL_IS_AHEAD)
    single.reset(seed=0)
    expected = sum(single.step(LEVEL)[1] for _ in range(3))
    environments = VecNormalize(VelocityVectorVecEnv("VVC/Hard-v0", 4, **GOAL_IS_AHEAD))
    returns, lengths = evaluate_policy(FliesLevel(), environments, n_eval_episodes=8, return_episode_rewards=True)
    assert lengths == [3] * 8
    assert returns == [pytest.approx(expected)] * 8


def test_monitor_may_be_put_around_it() -> None:
    environments = VelocityVectorVecEnv("VVC/Hard-v0", 4, **GOAL_IS_AHEAD)
    with pytest.warns(UserWarning, match="already wrapped with a `Monitor`"):
        monitored = VecMonitor(environments, info_keywords=("is_success", "termination"))
    monitored.reset()
    for _ in range(3):
        *_, dones, infos = monitored.step(np.tile(np.float32(LEVEL), (4, 1)))
    assert dones.all()
    for info in infos:
        assert info["episode"].items() >= {"l": 3, "is_success": True, "termination": "reach_target"}.items()


def test_imitations_wrappers_write_into_infos() -> None:
    wrapper = pytest.importorskip("imitation.rewards.reward_wrapper").RewardVecEnvWrapper
    inner = VelocityVectorVecEnv("VVC/Hard-v0", 4, seed=0)
    twin = VelocityVectorVecEnv("VVC/Hard-v0", 4, seed=0)
    wrapped = wrapper(inner, lambda *_: np.arange(4.0))
    twin.reset()
    actions = np.tile(np.float32(LEVEL), (4, 1))
    _, rewards, _, infos = wrapped.step(actions)
    np.testing.assert_array_equal(rewards, range(4))
    np.testing.assert_array_equal([info["original_env_rew"] for info in infos], twin.step(actions)[1])


def test_a_curriculum_replaces_the_goals() -> None:
    environments = VelocityVectorVecEnv("VVC/Hard-v0", 3, seed=0, **GOAL_IS_AHEAD)
    wrapped = VecNormalize(environments, norm_obs=False)
    wrapped.reset()
    wrapped.set_attr("goals", [(210.0, 5.0, 5.0)])
    for step in range(1, 4):
        observed, *_ = wrapped.step(np.tile(np.float32(LEVEL), (3, 1)))
        expected = (210, 5, 5) if step == 3 else (200, 0, 0)  # from the next episode on
        np.testing.assert_array_equal(observed["desired_goal"], np.tile(np.float32(expected), (3, 1)))
    with pytest.raises(ValueError, match="'goals' is one for all 3 aircraft; set it without indices"):
        environments.set_attr("goals", [(200, 0, 0)], indices=[0, 1])


def test_seeds_and_options_are_for_the_next_reset() -> None:
    environments = VelocityVectorVecEnv("VVC/Hard-v0", 3, seed=5)
    first, second = environments.reset()["desired_goal"], environments.reset()["desired_goal"]
    assert (first != second).all()
    environments.seed(5)
    np.testing.assert_array_equal(environments.reset()["desired_goal"], first)
    state = sim.start(environments.fleet.settings, altitude_m=3000)
    environments.set_options([{"goal": (220, 0, 0)}, {"state": state}, {}])
    observed = environments.reset()
    np.testing.assert_array_equal(observed["desired_goal"][0], [220, 0, 0])
    np.testing.assert_array_equal(observed["observation"][:, 7], [5000, 3000, 5000])
    assert (environments.reset()["observation"][:, 7] == 5000).all()
    environments.set_options({"goals": (200, 0, 0)})
    with pytest.raises(ValueError, match="unknown reset option 'goals'"):
        environments.reset()


def test_bad_actions_are_refused_and_nothing_changes() -> None:
    flights = []
    for bad in ([], [np.full((2, 3), np.nan)], [np.zeros((2, 4))]):
        environments = VelocityVectorVecEnv("VVC/Hard-v0", 2, seed=0)
        environments.reset()
        for actions in bad:
            with pytest.raises(ValueError, match=r"'roll_rate_degps' of aircraft 0 is NaN|must have shape"):
                environments.step(actions)
        flights.append(environments.step(np.tile(np.float32(LEVEL), (2, 1))))
    np.testing.assert_equal(flights[1:], [flights[0]] * 2)


def test_what_it_has_not_is_said() -> None:
    with pytest.raises(ValueError, match="unknown environment 'VVC/Easy-v0'; known are VVC/Normal-v0"):
        VelocityVectorVecEnv("VVC/Easy-v0", 2)
    environments = VelocityVectorVecEnv("VVC/Hard-v0", 2)
    assert environments.get_attr("task") == [environments.task] * 2
    assert environments.get_images() == [None, None]
    with pytest.raises(AttributeError, match="nothing_such"):
        environments.get_attr("nothing_such")
    with pytest.raises(AttributeError, match=r"env_method calls compute_reward, .* got 'reset'"):
        environments.env_method("reset", indices=[0])
