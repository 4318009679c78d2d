"""Flights as other libraries hold them: nothing out of step at the ends of trajectories, units and scales as theirs."""

from collections.abc import Callable

import gymnasium
import numpy as np
import pytest
from small_flights import delayed_flights, flights, same, surface_flights

from vvc_bench.datasets.convert.d4rl import to_d4rl
from vvc_bench.datasets.transitions import transitions_of
from vvc_bench.rollout import Episodes


@pytest.fixture(scope="module")
def flown() -> Episodes:
    return flights()


def first_and_last(episodes: Episodes, e: int) -> tuple[int, int]:
    return int(episodes.offsets[e]), int(episodes.offsets[e + 1]) - 1


# D4RL


def test_d4rl(flown: Episodes) -> None:
    made = to_d4rl(flown)
    assert {name: values.shape[0] for name, values in made.items()} == dict.fromkeys(made, len(flown.rewards))
    assert set(made) >= {"observations", "actions", "rewards", "next_observations", "terminals", "timeouts"}
    first, last = first_and_last(flown, 3)
    assert made["terminals"][first : last + 1].tolist() == [False] * (last - first) + [True]
    assert not made["timeouts"].any()
    np.testing.assert_array_equal(made["next_observations"][last], flown.final_observations[3])
    np.testing.assert_array_equal(made["next_observations"][first], made["observations"][first + 1])
    np.testing.assert_array_equal(made["infos/goal"][last], flown.goals[3])


def test_d4rl_calls_time_limits_and_stopped_records_timeouts() -> None:
    episodes = delayed_flights()
    made, last = to_d4rl(episodes), episodes.offsets[1:] - 1
    np.testing.assert_array_equal(made["timeouts"][last], episodes.final_events == 0)
    assert not (made["timeouts"] & made["terminals"]).any()
    assert (made["timeouts"] | made["terminals"]).sum() == len(episodes)


# PyTorch


def test_pytorch_loads_whole_batches(flown: Episodes) -> None:
    torch = pytest.importorskip("torch")
    from torch.utils.data import BatchSampler, DataLoader, RandomSampler

    from vvc_bench.datasets.convert.pytorch import TransitionDataset

    data, made = TransitionDataset(transitions_of(flown)), transitions_of(flown)
    assert isinstance(data, torch.utils.data.Dataset)
    assert len(data) == len(flown.rewards)
    assert data[7]["observations"].tolist() == made.observations[7].tolist()
    assert data[7]["rewards"].shape == ()
    sampler = BatchSampler(RandomSampler(data, generator=torch.Generator().manual_seed(0)), 256, drop_last=False)
    batches = list(DataLoader(data, batch_size=None, sampler=sampler))
    assert batches[0]["observations"].shape == (256, 8)
    assert {name: values.dtype for name, values in batches[0].items()} == {
        **dict.fromkeys(made._fields, torch.float32),
        **dict.fromkeys(["terminated", "truncated"], torch.bool),
    }
    rewards = torch.cat([batch["rewards"] for batch in batches]).numpy()
    np.testing.assert_array_equal(np.sort(rewards), np.sort(flown.rewards))
    one_by_one = next(iter(DataLoader(data, batch_size=4)))
    np.testing.assert_array_equal(one_by_one["next_observations"].numpy(), made.next_observations[:4])


def test_pytorch_tensors_are_their_own(flown: Episodes) -> None:
    torch = pytest.importorskip("torch")
    from vvc_bench.datasets.convert.pytorch import to_tensors

    made = transitions_of(flown)
    tensors = to_tensors(made)
    tensors["rewards"][:] = 1.0
    assert (made.rewards < 1.0).all()
    assert tensors["goals"].dtype == torch.float32


# imitation


def test_imitation_trajectories(flown: Episodes) -> None:
    pytest.importorskip("imitation")
    from imitation.data import rollout, types

    from vvc_bench.datasets.convert.imitation import to_trajectories, to_transitions

    trajectories = to_trajectories(flown)
    assert [len(trajectory) for trajectory in trajectories] == flown.lengths.tolist()
    first, last = first_and_last(flown, 5)
    one = trajectories[5]
    assert isinstance(one, types.TrajectoryWithRew)
    assert one.terminal
    seen = one.obs.get("observation")
    np.testing.assert_array_equal(seen[:-1], flown.observations[first : last + 1])
    np.testing.assert_array_equal(seen[-1], flown.final_observations[5])
    np.testing.assert_array_equal(one.obs.get("achieved_goal"), seen[:, 3:6])
    assert (one.obs.get("desired_goal") == flown.goals[5].astype(np.float32)).all()
    assert rollout.rollout_stats(trajectories)["return_mean"] == pytest.approx(
        np.mean([flown.rewards[slice(*flown.offsets[e : e + 2])].sum() for e in range(len(flown))]), rel=1e-5
    )
    transitions = to_transitions(flown)
    np.testing.assert_array_equal(transitions.next_obs.get("observation"), flown.next_observations)
    np.testing.assert_array_equal(np.flatnonzero(transitions.dones), flown.offsets[1:] - 1)
    np.testing.assert_array_equal(transitions.rews, flown.rewards)
    np.testing.assert_array_equal(transitions.acts, flown.actions)


def test_imitation_is_told_of_records_that_stop() -> None:
    pytest.importorskip("imitation")
    from vvc_bench.datasets.convert.imitation import to_trajectories

    episodes = delayed_flights()
    terminal = [trajectory.terminal for trajectory in to_trajectories(episodes)]
    assert terminal == (episodes.final_events != 0).tolist()


@pytest.mark.filterwarnings("ignore::UserWarning")  # imitation's own
def test_imitation_learns_from_them(flown: Episodes) -> None:
    """Behavioural cloning of imitation, on the dictionaries that the environments give."""
    torch = pytest.importorskip("torch")
    pytest.importorskip("imitation")
    from imitation.algorithms.bc import BC
    from imitation.util.logger import configure
    from stable_baselines3.common.policies import MultiInputActorCriticPolicy

    from vvc_bench.datasets.convert.imitation import to_transitions

    torch.manual_seed(0)
    environment = gymnasium.make("VVC/Hard-v0")
    spaces = environment.observation_space, environment.action_space
    learner = BC(
        observation_space=spaces[0],
        action_space=spaces[1],
        rng=np.random.default_rng(0),
        demonstrations=to_transitions(flown),
        policy=MultiInputActorCriticPolicy(*spaces, lambda _: 1e-3),
        custom_logger=configure(None, []),
        device="cpu",
    )
    observations = {name: torch.from_numpy(values) for name, values in environment.reset(seed=0)[0].items()}
    before = learner.policy.get_distribution({name: v[None] for name, v in observations.items()}).mode()
    learner.train(n_epochs=1, progress_bar=False, log_interval=10**9)
    after = learner.policy.get_distribution({name: v[None] for name, v in observations.items()}).mode()
    assert not torch.equal(before, after)


# Stable-Baselines3


def test_a_replay_buffer_is_as_if_it_had_been_recorded(flown: Episodes) -> None:
    """The same arrays as SAC's own collection leaves when it is made to fly the same actions."""
    pytest.importorskip("stable_baselines3")
    from stable_baselines3 import SAC
    from stable_baselines3.common.buffers import DictReplayBuffer
    from stable_baselines3.common.vec_env import DummyVecEnv

    from vvc_bench.datasets.convert.stable_baselines import to_replay_buffer

    few = flown.select([2, 9])
    made = to_replay_buffer(few, device="cpu")
    assert isinstance(made, DictReplayBuffer)
    assert (made.size(), made.full, made.pos) == (len(few.rewards), True, 0)
    task = {name: few.scenario.to_json()["task"][name] for name in ("step_limit", "terminations")}
    learner = SAC("MultiInputPolicy", DummyVecEnv([lambda: gymnasium.make("VVC/Hard-v0", **task)]), device="cpu")
    recorded = DictReplayBuffer(1000, learner.observation_space, learner.action_space, device="cpu")
    environment = gymnasium.make("VVC/Hard-v0", **task)
    for e in range(2):
        seen, _ = environment.reset(options={"goal": few.goals[e]})
        for action in few.actions[slice(*few.offsets[e : e + 2])]:
            after, reward, terminated, truncated, _ = environment.step(action)
            scaled = learner.policy.scale_action(action)
            infos = [{"TimeLimit.truncated": truncated and not terminated}]
            recorded.add(seen, after, scaled, np.array([reward]), np.array([terminated or truncated]), infos)
            seen = after
    count = recorded.size()
    assert count == made.size()
    for key in recorded.observations:
        np.testing.assert_array_equal(made.observations[key], recorded.observations[key][:count])
        np.testing.assert_array_equal(made.next_observations[key], recorded.next_observations[key][:count])
    np.testing.assert_allclose(made.actions, np.clip(recorded.actions[:count], -1, 1), atol=1e-6)
    for name in ("rewards", "dones", "timeouts"):
        np.testing.assert_array_equal(getattr(made, name), getattr(recorded, name)[:count])
    assert made.sample(64).observations["observation"].shape == (64, 8)


def test_a_replay_buffer_with_room(flown: Episodes) -> None:
    pytest.importorskip("stable_baselines3")
    from vvc_bench.datasets.convert.stable_baselines import to_replay_buffer

    count = len(flown.rewards)
    made = to_replay_buffer(flown, buffer_size=count + 10, device="cpu")
    assert (made.size(), made.full, made.pos) == (count, False, count)
    assert np.abs(made.actions).max() <= 1.0
    with pytest.raises(ValueError, match=f"a buffer of 10 has no room for {count} transitions"):
        to_replay_buffer(flown, buffer_size=10)


def test_a_flat_replay_buffer(flown: Episodes) -> None:
    pytest.importorskip("stable_baselines3")
    from stable_baselines3.common.buffers import ReplayBuffer

    from vvc_bench.datasets.convert.stable_baselines import to_replay_buffer

    made = to_replay_buffer(flown, ReplayBuffer, device="cpu")
    environment = gymnasium.wrappers.FlattenObservation(gymnasium.make("VVC/Hard-v0"))
    assert made.observation_space == environment.observation_space
    seen, _ = environment.reset(options={"goal": flown.goals[0]})
    np.testing.assert_array_equal(made.observations[0, 0], seen)
    seen = environment.step(flown.actions[0])[0]
    np.testing.assert_array_equal(made.next_observations[0, 0], seen)


def test_hindsight_knows_where_episodes_lie(flown: Episodes) -> None:
    pytest.importorskip("stable_baselines3")
    from stable_baselines3 import HerReplayBuffer
    from stable_baselines3.common.vec_env import DummyVecEnv

    from vvc_bench.datasets.convert.stable_baselines import to_replay_buffer

    environment = DummyVecEnv([lambda: gymnasium.make("VVC/Hard-v0", reach_steps=1, reward="sparse")])
    count = len(flown.rewards)
    options = {"env": environment, "goal_selection_strategy": "final", "n_sampled_goal": 1000}
    made = to_replay_buffer(flown, HerReplayBuffer, buffer_size=count + 500, device="cpu", **options)
    batch = made.sample(200)
    ends = {tuple(goal) for goal in flown.final_observations[:, 3:6].tolist()}
    assert {tuple(goal) for goal in batch.observations["desired_goal"].tolist()[1:]} <= ends
    seen = {name: values[:1, 0] for name, values in made.observations.items()}
    for step in range(40):
        made.add(seen, seen, np.zeros((1, 3)), np.zeros(1), np.array([step == 39]), [{}])
    assert made.ep_start[count : count + 40, 0].tolist() == [count] * 40
    assert made.ep_length[count : count + 40, 0].tolist() == [40] * 40
    made.sample(200)


# Minari


def with_minari(test: Callable[..., None]) -> Callable[..., None]:
    """Minari at home in a folder of the test, whatever it wants to have said about authors."""
    return pytest.mark.usefixtures("minari_home")(pytest.mark.filterwarnings("ignore::UserWarning")(test))


@pytest.fixture
def minari_home(tmp_path: object, monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("minari")
    monkeypatch.setenv("MINARI_DATASETS_PATH", str(tmp_path))


@with_minari
@pytest.mark.parametrize(
    "make", [flights, delayed_flights, surface_flights], ids=["guidance", "delay, gusts and own starts", "surfaces"]
)
def test_minari_and_back(make: type[Episodes]) -> None:
    import minari

    from vvc_bench.datasets.convert.minari import from_minari, to_minari

    episodes = make()
    to_minari(episodes, "vvc/small-v0", algorithm_name="pid")
    stored = minari.load_dataset("vvc/small-v0")
    assert (stored.total_episodes, stored.total_steps) == (len(episodes), len(episodes.rewards))
    for e in (0, len(episodes) - 1):
        record = stored[e]
        steps = slice(*episodes.offsets[e : e + 2])
        np.testing.assert_array_equal(record.observations["observation"][:-1], episodes.observations[steps])
        np.testing.assert_array_equal(record.observations["observation"][-1], episodes.final_observations[e])
        np.testing.assert_array_equal(record.rewards, episodes.rewards[steps])
        assert (record.terminations | record.truncations).tolist() == [False] * (len(record.rewards) - 1) + [True]
    back = from_minari("vvc/small-v0")
    assert set(back.sources) == {"vvc/small-v0"}
    named = Episodes(**{**vars(back), "sources": episodes.sources, "scenario": back.scenario})
    assert same(named, episodes)


@with_minari
def test_minari_recovers_the_environment(flown: Episodes) -> None:
    from vvc_bench.datasets.convert.minari import to_minari

    stored = to_minari(flown.select([1]), "vvc/one-v0")
    environment = stored.recover_environment()
    options = next(iter(stored.storage.get_episode_metadata([0])))["options"]
    seen, _ = environment.reset(options=options)
    for action, expected in zip(stored[0].actions, stored[0].observations["observation"], strict=False):
        np.testing.assert_array_equal(seen["observation"], expected)
        seen, *_ = environment.step(action)


@with_minari
@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")  # its recorder's temporary folders
def test_recordings_by_minari_itself_are_read() -> None:
    import minari

    from vvc_bench.datasets.convert.minari import from_minari

    options = {"step_limit": 300, "goals": [[200, 0, 0], [210, 5, 10]]}
    recorder = minari.DataCollector(gymnasium.make("VVC/Normal-v0", **options))
    for seed in range(3):
        recorder.reset(seed=seed)
        over = False
        while not over:
            _, _, terminated, truncated, _ = recorder.step(np.array([0.0, 1.0, 0.3], dtype=np.float32))
            over = terminated or truncated
    stored = recorder.create_dataset("vvc/recorded-v0")
    recorder._tmp_dir.cleanup()  # else the garbage collector does it, and warns
    read = from_minari(stored)
    assert (len(read), read.scenario.task.step_limit) == (3, 300)
    np.testing.assert_array_equal(read.rewards[: len(stored[0].rewards)], stored[0].rewards.astype(np.float32))


@with_minari
def test_minari_sets_that_do_not_fly_are_refused(flown: Episodes) -> None:
    import minari
    from minari.data_collector import EpisodeBuffer

    from vvc_bench.datasets.convert.minari import from_minari, to_minari

    wrong = flown.select([0, 1])
    wrong.observations[-3, 0] += 1.0
    to_minari(wrong, "vvc/wrong-v0")
    with pytest.raises(ValueError, match=r"episode 1 of vvc/wrong-v0 is not what its actions fly"):
        from_minari("vvc/wrong-v0")
    space = gymnasium.make("CartPole-v1")
    buffer = EpisodeBuffer(
        observations=np.zeros((2, 4), np.float32),
        actions=np.zeros(1, np.int64),
        rewards=[1.0],
        terminations=[True],
        truncations=[False],
    )
    minari.create_dataset_from_buffers("vvc/poles-v0", [buffer], env=space)
    with pytest.raises(ValueError, match="not in a VVC environment"):
        from_minari("vvc/poles-v0")
