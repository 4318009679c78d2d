"""A dataset in use: columns, choices, splits, random batches, other rewards, the environment again."""

import itertools
import pickle
import subprocess
import sys
from pathlib import Path

import gymnasium
import numpy as np
import pytest
from small_flights import TASK, delayed_flights, flights, same, surface_flights

from vvc_bench.datasets import schema
from vvc_bench.datasets.dataset import Dataset
from vvc_bench.datasets.manifest import MANIFEST, TRANSITIONS
from vvc_bench.datasets.store import CorruptDataset, Description, open_dataset, write_dataset
from vvc_bench.rollout import Episodes, concatenate, replay
from vvc_bench.sim.fields import Observation, columns
from vvc_bench.tasks import make_task


@pytest.fixture(scope="module")
def flown() -> Episodes:
    return flights()


@pytest.fixture
def dataset(flown: Episodes, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Dataset:
    monkeypatch.setattr(schema, "ROWS_OF_A_GROUP", 500)
    monkeypatch.setenv("VVC_BENCH_HOME", str(tmp_path / "home"))
    return open_dataset(write_dataset(tmp_path / "small-v0", flown, Description("small-v0")))


# Reading


def test_opening_reads_the_manifest_alone(dataset: Dataset) -> None:
    script = (
        "import sys, time, vvc_bench.datasets.store as store; start = time.perf_counter();"
        "dataset = store.open_dataset(sys.argv[1]); taken = time.perf_counter() - start;"
        "print(len(dataset), dataset.scenario.settings.frequency_hz, 'pyarrow' in sys.modules, taken < 0.05)"
    )
    (dataset.folder / TRANSITIONS).write_bytes(bytes((dataset.folder / TRANSITIONS).stat().st_size))
    done = subprocess.run([sys.executable, "-c", script, dataset.folder], capture_output=True, text=True, check=True)
    assert done.stdout.split() == [str(len(dataset)), "10.0", "False", "True"]


def test_columns_are_those_of_the_flights(dataset: Dataset, flown: Episodes) -> None:
    table = dataset.columns()
    for name, values in schema.transition_values(flown).items():
        np.testing.assert_array_equal(table[name], values)
    assert list(dataset.columns(["reward", "speed_mps"])) == ["reward", "speed_mps"]
    np.testing.assert_array_equal(dataset.column("action_throttle"), flown.actions[:, 2])
    np.testing.assert_array_equal(dataset.goals, flown.goals)
    np.testing.assert_array_equal(dataset.lengths, flown.lengths)
    assert set(dataset.episode_column("source")) == {"pid"}
    with pytest.raises(ValueError, match="unknown column 'speed'; known are episode, step, roll_deg"):
        dataset.column("speed")
    with pytest.raises(ValueError, match="unknown column 'speed_mps'; known are episode, goal_speed_mps"):
        dataset.episode_column("speed_mps")


def test_one_flight_at_a_time(dataset: Dataset, flown: Episodes) -> None:
    for e in (0, 17, len(flown) - 1, -1, -len(flown)):
        assert same(dataset[e], flown.select([e]))
    assert same(concatenate(list(dataset)), flown)
    chosen = [30, 2, 3, 2, 39]
    assert same(concatenate(list(dataset.select(chosen))), flown.select(chosen))
    assert list(dataset.select([])) == []
    for wrong in (len(flown), -len(flown) - 1):
        with pytest.raises(IndexError, match=f"episode {wrong} of {len(flown)}"):
            dataset[wrong]


def test_a_choice_is_a_dataset(dataset: Dataset, flown: Episodes) -> None:
    generator = np.random.default_rng(0)
    for which in (
        generator.permutation(len(flown)),
        generator.integers(len(flown), size=100),
        generator.random(len(flown)) < 0.3,
        np.array([-1, 0]),
        [],
    ):
        part = dataset.select(which)
        expected = flown.select(np.asarray(which, dtype=np.int64) if not len(which) else which)
        assert len(part) == len(expected)
        assert same(part.read(), expected)
        np.testing.assert_array_equal(part.column("reward"), expected.rewards)
        np.testing.assert_array_equal(part.goals, expected.goals)
    assert same(dataset.select(slice(3, 20, 4)).select([1, 0]).read(), flown.select([7, 3]))
    assert repr(dataset) == f"<Dataset small-v0: {len(flown)} episodes, {len(flown.rewards)} transitions>"
    assert repr(dataset.select([1])).startswith(f"<Dataset small-v0: 1 of {len(flown)} episodes")


def test_a_choice_reads_its_row_groups_alone(dataset: Dataset, flown: Episodes) -> None:
    groups = dataset.episode_column("row_group")
    content = (dataset.folder / TRANSITIONS).read_bytes()
    (dataset.folder / TRANSITIONS).write_bytes(bytes(len(content) // 2) + content[len(content) // 2 :])
    last = np.flatnonzero(groups == groups.max())
    assert same(dataset.select(last).read(), flown.select(last))
    with pytest.raises(CorruptDataset):
        dataset.select([0]).read()


def test_filters(dataset: Dataset, flown: Episodes) -> None:
    speed, _, azimuth = flown.goals.T
    near = dataset.where(goal_speed_mps=(190, 210), goal_azimuth_deg=(-20, 20), length=(0, 90))
    mask = (speed == 200) & (np.abs(azimuth) <= 20) & (flown.lengths <= 90)
    assert 0 < len(near) < len(flown)
    assert same(near.read(), flown.select(mask))
    assert len(dataset.where(source="pid")) == len(dataset.where(source=["pid", "other"])) == len(dataset)
    assert len(dataset.where(source="other")) == len(dataset.where(outcome="crash")) == 0
    assert len(dataset.where(outcome="reach_target", length=(-np.inf, np.inf))) == len(dataset)
    with pytest.raises(ValueError, match="unknown column 'speed'"):
        dataset.where(speed=(1, 2))
    with pytest.raises(ValueError, match=r"length needs bounds as in length=\(low, high\), got 3"):
        dataset.where(length=3)


def test_quantiles(dataset: Dataset, flown: Episodes) -> None:
    short = dataset.between_quantiles("length", 0.0, 0.25)
    assert short.lengths.max() <= np.quantile(flown.lengths, 0.25) < np.setdiff1d(flown.lengths, short.lengths).min()
    assert abs(len(short) - len(flown) / 4) < 4
    best = short.between_quantiles("return", 0.5, 1.0)
    assert best.episode_column("return").min() >= np.median(short.episode_column("return"))
    assert len(dataset.between_quantiles("length", 0.0, 1.0)) == len(dataset)
    assert len(dataset.select([]).between_quantiles("length", 0.0, 0.5)) == 0
    with pytest.raises(ValueError, match="quantiles must be 0 ≤ low ≤ high ≤ 1"):
        dataset.between_quantiles("length", 0.5, 0.2)


# Splits


def goals_of(dataset: Dataset) -> set[tuple[float, ...]]:
    return set(map(tuple, dataset.goals.tolist()))


def test_a_split_shares_no_goal(dataset: Dataset, flown: Episodes, tmp_path: Path) -> None:
    train, validation = dataset.split(0.3)
    assert len(train) + len(validation) == len(dataset)
    assert min(len(train), len(validation)) > 0
    assert goals_of(train).isdisjoint(goals_of(validation))
    mirrored = {(speed, path_angle, -azimuth) for speed, path_angle, azimuth in goals_of(validation)}
    assert goals_of(train).isdisjoint(mirrored)
    again, other = dataset.split(0.3)[1], dataset.split(0.3, seed=1)[1]
    assert goals_of(again) == goals_of(validation) != goals_of(other)
    folder = write_dataset(tmp_path / "other", flown.select(np.arange(len(flown))[::-2]), Description("other"))
    elsewhere = open_dataset(folder).split(0.3)
    assert goals_of(elsewhere[1]) <= goals_of(validation)
    assert goals_of(elsewhere[0]) <= goals_of(train)
    assert (len(dataset.split(0.0)[1]), len(dataset.split(1.0)[0])) == (0, 0)
    with pytest.raises(ValueError, match=r"must lie in \[0, 1\], got 10"):
        dataset.split(10)


def test_the_share_of_goals_is_about_what_was_asked_for(tmp_path: Path, flown: Episodes) -> None:
    goals = np.random.default_rng(0).uniform((100, -80, -170), (300, 80, 170), (4000, 3))
    actions = np.zeros((4000, 3), dtype=np.float32)
    many = replay(flown.scenario, goals, actions, np.arange(4001))
    dataset = open_dataset(write_dataset(tmp_path / "many", many, Description("many")))
    for seed, share in itertools.product(range(3), (0.1, 0.5)):
        assert len(dataset.split(share, seed)[1]) / 4000 == pytest.approx(share, abs=0.03)


def test_seen_goals(dataset: Dataset, flown: Episodes) -> None:
    np.testing.assert_array_equal(dataset.seen_goals, np.unique(flown.goals, axis=0))
    train, validation = dataset.split(0.3)
    assert train.is_seen(train.goals).all()
    assert not train.is_seen(validation.goals).any()
    assert train.is_seen(dataset.goals).sum() == len(train)
    assert dataset.is_seen([200, 0, -0.0]).tolist() == [True]
    assert dataset.is_seen([[200, 0, 1e-12], [200, 0, 0.001]]).tolist() == [True, False]
    with pytest.raises(ValueError, match="goal path_angle_deg"):
        dataset.is_seen([200, 100, 0])


# Learning


def test_statistics_normalise(dataset: Dataset, flown: Episodes) -> None:
    figures = dataset.statistics()
    normal = (flown.observations.astype(float) - figures.mean) / figures.std
    np.testing.assert_allclose(normal.mean(axis=0), 0.0, atol=1e-6)
    np.testing.assert_allclose(normal.std(axis=0), 1.0, atol=1e-6)
    np.testing.assert_array_equal(figures.max.astype(np.float32), flown.observations.max(axis=0))
    assert dataset.select([0]).statistics(["reward"]).min == pytest.approx(flown.rewards.min())
    with pytest.raises(ValueError, match="unknown column 'step'"):
        dataset.statistics(["step"])


def test_transitions_have_their_true_successors(dataset: Dataset, flown: Episodes) -> None:
    made = dataset.transitions()
    np.testing.assert_array_equal(made.next_observations, flown.next_observations)
    last = flown.offsets[1:] - 1
    np.testing.assert_array_equal(made.next_observations[last], flown.final_observations)
    inside = np.setdiff1d(np.arange(len(flown.rewards)), last)
    np.testing.assert_array_equal(made.next_observations[inside], made.observations[inside + 1])
    np.testing.assert_array_equal(np.flatnonzero(made.terminated | made.truncated), last)
    np.testing.assert_array_equal(made.goals, flown.goals[flown.transition_episodes()])


def test_a_record_that_stops_is_truncated(tmp_path: Path) -> None:
    episodes = delayed_flights()
    made = open_dataset(write_dataset(tmp_path / "set", episodes, Description("a"))).transitions()
    last = episodes.offsets[1:] - 1
    assert (episodes.final_events == 0).any()
    np.testing.assert_array_equal(made.truncated[last], episodes.final_events == 0)
    np.testing.assert_array_equal(made.terminated[last], episodes.final_events != 0)


def test_the_training_cache(dataset: Dataset, tmp_path: Path) -> None:
    expected = dataset.transitions()
    for _ in range(2):
        mapped = dataset.memory_mapped()
        for name, values in expected._asdict().items():
            assert isinstance(getattr(mapped, name), np.memmap)
            np.testing.assert_array_equal(getattr(mapped, name), values)
    batch = mapped.sample(np.random.default_rng(0), 256)
    rows = np.random.default_rng(0).integers(len(expected.rewards), size=256)
    for name, values in expected._asdict().items():
        np.testing.assert_array_equal(getattr(batch, name), values[rows])
    part = dataset.select([5, 1])
    np.testing.assert_array_equal(part.memory_mapped().rewards, part.transitions().rewards)
    kept = tmp_path / "home" / "training-cache"
    assert sorted(path.name[:64] for path in kept.iterdir()) == [dataset.hash] * 2
    with pytest.raises(ValueError, match="has no episodes to train with"):
        dataset.select([]).memory_mapped()


def test_a_damaged_training_cache_is_made_anew(dataset: Dataset, tmp_path: Path) -> None:
    expected = dataset.memory_mapped().observations.copy()
    path = tmp_path / "home" / "training-cache" / dataset.hash / "observations.npy"
    content = path.read_bytes()
    for damaged in (content[:-1], content[:500] + bytes([content[500] ^ 1]) + content[501:], b""):
        path.write_bytes(damaged)
        np.testing.assert_array_equal(dataset.memory_mapped().observations, expected)
        assert path.read_bytes() == content


def test_frames(dataset: Dataset, flown: Episodes) -> None:
    frame = dataset.to_pandas()
    assert list(frame) == list(schema.transition_columns(flown.scenario))
    means = frame.groupby("episode")["speed_mps"].mean()
    assert means[3] == pytest.approx(flown.select([3]).observations[:, 3].mean())
    table = dataset.where(goal_speed_mps=(200, 200)).episodes_to_pandas()
    assert (table["goal_speed_mps"] == 200).all()
    assert table["episode"].tolist() == np.flatnonzero(flown.goals[:, 0] == 200).tolist()


def test_other_processes_get_the_same(dataset: Dataset, flown: Episodes) -> None:
    part = dataset.select([4, 2])
    assert same(pickle.loads(pickle.dumps(part)).read(), flown.select([4, 2]))
    content = pickle.dumps(part)
    write_dataset(dataset.folder, flown.select([1]), Description("small-v0"))
    assert same(part.read(), flown.select([4, 2]))
    with pytest.raises(CorruptDataset, match="holds another set than before"):
        pickle.loads(content)


# Tasks


def test_relabelling_gives_what_the_environment_gives(dataset: Dataset, flown: Episodes) -> None:
    sparse = dataset.relabelled(reward="sparse", penalty="constant", reach_steps=3)
    assert (sparse.lengths < flown.lengths).any()
    assert sparse.scenario.task == make_task(TASK, reward="sparse", penalty="constant", reach_steps=3)
    environment = dataset.environment(reward="sparse", penalty="constant", reach_steps=3)
    for e in (0, 20, len(sparse) - 1):
        environment.reset(options={"goal": sparse.goals[e]})
        for t in range(sparse.offsets[e], sparse.offsets[e + 1]):
            _, reward, terminated, truncated, info = environment.step(sparse.actions[t])
            assert (np.float32(reward), info["events"]) == (sparse.rewards[t], sparse.events[t])
        assert terminated
        assert not truncated
    assert same(dataset.relabelled(), flown)


def test_a_stricter_task_leaves_flights_without_an_end(dataset: Dataset, flown: Episodes) -> None:
    strict = dataset.select([0, 1]).relabelled(reach_steps=50)
    np.testing.assert_array_equal(strict.lengths, flown.lengths[:2])
    assert strict.final_events.tolist() == [0, 0]


@pytest.mark.parametrize("make", [flights, surface_flights], ids=["guidance", "surfaces"])
def test_the_environment_flies_the_same_flights(tmp_path: Path, make: type[Episodes]) -> None:
    episodes = make()
    dataset = open_dataset(write_dataset(tmp_path / "set", episodes, Description("a")))
    environment = dataset.environment()
    for e in (0, len(episodes) - 1):
        one = dataset[e]
        seen, _ = environment.reset(seed=e, options={"goal": one.goals[0]})
        for t, action in enumerate(one.actions):
            np.testing.assert_array_equal(seen["observation"], one.observations[t])
            seen, reward, terminated, _, info = environment.step(action)
            assert (np.float32(reward), info["events"]) == (one.rewards[t], one.events[t])
        np.testing.assert_array_equal(seen["observation"], one.final_observations[0])
        assert terminated == bool(one.reached[0])


def test_environments_draw_the_goals_of_the_choice(dataset: Dataset) -> None:
    _, validation = dataset.split(0.3)
    environment = validation.environment()
    for seed in range(20):
        assert tuple(environment.reset(seed=seed)[0]["desired_goal"].tolist()) in goals_of(validation)
    other = dataset.environment(goals=[[150, 0, 90]])
    assert other.reset(seed=0)[0]["desired_goal"].tolist() == [150, 0, 90]


@pytest.mark.skipif(not hasattr(gymnasium.vector, "AutoresetMode"), reason="takes Gymnasium 1.1")
def test_the_vector_environment(dataset: Dataset, flown: Episodes) -> None:
    environments = dataset.vector_environment(5, autoreset_mode="Disabled")
    seen, _ = environments.reset(seed=0, options={"goal": flown.goals[:5]})
    for t in range(int(flown.lengths[:5].min())):
        rows = flown.offsets[:5] + t
        np.testing.assert_array_equal(seen["observation"], flown.observations[rows])
        seen, rewards, *_ = environments.step(flown.actions[rows])
        np.testing.assert_array_equal(rewards.astype(np.float32), flown.rewards[rows])


def test_the_manifest_is_enough_to_know_what_there_is(dataset: Dataset) -> None:
    assert dataset.name == "small-v0"
    assert dataset.manifest["counts"]["episodes"] == len(dataset)
    assert (dataset.folder / MANIFEST).stat().st_size < 20_000
    assert set(dataset.manifest["columns"]["transitions"]) > set(columns(Observation))


def test_iterating_reads_each_row_group_once(dataset: Dataset, monkeypatch: pytest.MonkeyPatch) -> None:
    table, groups = dataset._stored.transitions, []
    read = table.read
    monkeypatch.setattr(table, "read", lambda names, wanted: [groups.extend(wanted), read(names, wanted)][1])
    assert len(list(dataset)) == len(dataset)
    assert groups == np.unique(dataset.episode_column("row_group")).tolist()
