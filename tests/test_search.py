"""Pursuit, manoeuvres and the search for them: twins, symmetry, and sets that are a function of their specification."""

import hashlib
import math
from pathlib import Path

import gymnasium
import numpy as np
import pytest
from numpy.typing import NDArray

from vvc_bench import sim
from vvc_bench.datasets.build import build_dataset
from vvc_bench.datasets.catalogue import (
    CATALOGUE,
    HARD,
    PAPER_GRID,
    SAMPLE_GRID,
    Axis,
    GoalGrid,
    Mirrored,
    Searched,
    Specification,
)
from vvc_bench.datasets.dataset import Dataset
from vvc_bench.datasets.searching import search_plans
from vvc_bench.datasets.store import open_dataset
from vvc_bench.datasets.verify import fly_again
from vvc_bench.experts import PURSUIT, Goal, PursuitParameters, pursuit_command, pursuit_commands
from vvc_bench.experts.manoeuvre import (
    MIRROR,
    WIDTH,
    Caution,
    Manoeuvre,
    Preparation,
    load_manoeuvre,
    manoeuvre_command,
)
from vvc_bench.experts.pid import TABLE_1
from vvc_bench.goals import SCALE
from vvc_bench.rollout import Scenario, fly_law
from vvc_bench.search import FAILED, Budget, Found, neighbours
from vvc_bench.sim.fields import Conditions, Observation, field_array
from vvc_bench.sim.task import direction_error
from vvc_bench.tasks import TASKS

GRID = GoalGrid(Axis(160.0, 240.0, 3), Axis(-30.0, 30.0, 3), Axis(-90.0, 90.0, 5))
BUDGET = Budget(sweeps=3, generations=1, population=8)
SMALL = Specification("search-small-v0", "45 goals", HARD, Searched(GRID, BUDGET))
GUIDANCE_SCALE = field_array(sim.GuidanceCommand, "scale")


def search(folder: Path, budget: Budget = BUDGET, **options: object) -> tuple[Found, list[int]]:
    found, reached, _ = search_plans(HARD, GRID, budget, folder, **{"seed": 0, **options})
    return found, reached.tolist()


@pytest.fixture(scope="module")
def found(tmp_path_factory: pytest.TempPathFactory) -> tuple[Found, list[int]]:
    return search(tmp_path_factory.mktemp("search"))


def as_flown(seen: dict[str, NDArray[np.float32]]) -> tuple[Observation, Goal]:
    view = Observation(*(seen["observation"].astype(float) / field_array(Observation, "scale")))
    return view, Goal(*(seen["desired_goal"].astype(float) / SCALE))


# Pursuit


def test_pursuit_reaches_far_more_than_the_law_of_appendix_c() -> None:
    pursuit, pid = (len(fly_law(HARD, SAMPLE_GRID.goals, law).episodes) for law in (PURSUIT, TABLE_1))
    assert pursuit > 0.6 * len(SAMPLE_GRID.goals)
    assert pursuit > 1.3 * pid


def test_the_mirrored_flight_gets_the_mirrored_command() -> None:
    random = np.random.default_rng(0)
    states = np.tile(sim.start(sim.Settings()), (200, 1))
    for name in ("roll", "yaw", "azimuth", "pitch", "path_angle"):
        spread = math.pi if name in ("roll", "yaw", "azimuth") else 1.5
        states[:, sim.State._fields.index(name)] = random.uniform(-spread, spread, 200)
    goals = np.stack([random.uniform(low, high, 200) for low, high in ((100, 300), (-1.5, 1.5), (-3, 3))], axis=-1)
    expected = pursuit_commands(states, goals) * field_array(sim.GuidanceCommand, "mirror")
    flipped = pursuit_commands(states * field_array(sim.State, "mirror"), goals * field_array(Goal, "mirror"))
    np.testing.assert_allclose(flipped, expected, atol=1e-9)


@pytest.mark.parametrize(("azimuth", "path_angle", "roll_sign"), [(1.0, 0.0, 1), (-1.0, 0.0, -1), (0.0, 0.5, 0)])
def test_pursuit_rolls_towards_the_goal_and_pulls(azimuth: float, path_angle: float, roll_sign: int) -> None:
    state = sim.State(*sim.start(sim.Settings()))
    command = pursuit_command(state, Goal(200.0, path_angle, azimuth), PURSUIT)
    assert np.sign(round(command.roll_rate, 6)) == roll_sign
    assert command.load_factor > (1.5 if path_angle else 0.9)


def test_pursuit_dives_for_speed_that_is_missing_and_climbs_with_too_much() -> None:
    state = sim.State(*sim.start(sim.Settings()))
    still = PURSUIT._replace(height_gain=0.0)
    level = pursuit_command(state, Goal(200.0, 0.0, 0.0), still).load_factor
    assert pursuit_command(state, Goal(300.0, 0.0, 0.0), still).load_factor == level
    assert pursuit_command(state, Goal(300.0, 0.0, 0.0), PURSUIT).load_factor < level
    assert pursuit_command(state, Goal(100.0, 0.0, 0.0), PURSUIT).load_factor > level


def test_bad_figures_are_named() -> None:
    states = np.tile(sim.start(sim.Settings()), (1, 1))
    with pytest.raises(ValueError, match="parameters must be finite"):
        pursuit_commands(states, [(200.0, 0.0, 0.0)], PursuitParameters(turn_gain=math.inf))
    with pytest.raises(ValueError, match=r"got states \(1, 5\)"):
        pursuit_commands(states[:, :5], [(200.0, 0.0, 0.0)])
    with pytest.raises(ValueError, match="one manoeuvre for all or one for each of 3 goals, got 2"):
        fly_law(HARD, SAMPLE_GRID.goals[:3], np.zeros((2, WIDTH)))
    with pytest.raises(ValueError, match=rf"shape \(E, {WIDTH}\), got shape \(3, {WIDTH - 1}\)"):
        fly_law(HARD, SAMPLE_GRID.goals[:3], np.zeros((3, WIDTH - 1)))


# Manoeuvres


def test_a_manoeuvre_flies_in_the_environment_as_in_the_compiled_loop(found: tuple[Found, list[int]]) -> None:
    """Action by action, with the task's counters kept by hand; impatient plans, so that they turn back."""
    rows = found[0].plans[:, 0].copy()
    rows[:, -len(Caution._fields) :] = (4.0, 3.0)
    longest = np.argsort(-rows[:, Preparation._fields.index("duration")])[:6]
    flown = [fly_law(HARD, GRID.goals[k], rows[k]).episodes for k in longest]
    kept = [(k, episodes) for k, episodes in zip(longest, flown, strict=True) if len(episodes)]
    assert len(kept) >= 3
    turned_back = 0
    for k, episodes in kept:
        turned_back += fly_by_hand(load_manoeuvre(rows, k), GRID.goals[k], episodes.actions)
    assert turned_back > 0


def fly_by_hand(manoeuvre: Manoeuvre, goal: NDArray[np.float64], actions: NDArray[np.float32]) -> int:
    """Compare each action with the manoeuvre's command; how often the plan turned back."""
    environment = gymnasium.make("vvc_bench:VVC/Hard-v0")
    seen, _ = environment.reset(options={"goal": goal})
    away = negative = turned_back = 0
    for step, expected in enumerate(actions):
        view, target = as_flown(seen)
        before = direction_error(view.path_angle, view.azimuth, target)
        turned_back += away >= manoeuvre.caution.moving_away_steps
        command = manoeuvre_command(view, target, step * 0.1, Caution(away, negative), manoeuvre)
        action = (np.array(command) * GUIDANCE_SCALE).astype(np.float32)
        np.testing.assert_array_equal(action, expected)
        seen, _, _, _, _ = environment.step(action)
        view, target = as_flown(seen)
        state = environment.unwrapped.state
        away = away + 1 if direction_error(view.path_angle, view.azimuth, target) > before else 0
        banked = abs(state.roll) > HARD.task.steep_bank and state.load_factor < HARD.task.least_load_factor
        negative = negative + 1 if banked else 0
    return turned_back


def test_mirrored_plans_fly_nearly_the_mirrored_flight(found: tuple[Found, list[int]]) -> None:
    mirrored_goals = GRID.goals * field_array(Goal, "mirror")
    plain, image = (
        fly_law(HARD, goals, rows)
        for goals, rows in ((GRID.goals, found[0].plans[:, 0]), (mirrored_goals, found[0].plans[:, 0] * MIRROR))
    )
    both = (plain.last_events & image.last_events & 1) != 0
    assert both.mean() > 0.6
    lengths = [each.episodes.lengths[both[(each.last_events & 1) != 0]] for each in (plain, image)]
    assert np.median(np.abs(lengths[0] - lengths[1])) <= 1


# The search


def test_what_is_found_is_what_is_flown(found: tuple[Found, list[int]]) -> None:
    plans, _ = found
    goals, ways = plans.kept(1.0)
    flown = fly_law(HARD, GRID.goals[goals], plans.plans[goals, ways])
    reached = plans.scores[goals, ways] < FAILED
    np.testing.assert_array_equal((flown.last_events & 1) != 0, reached)
    np.testing.assert_array_equal(flown.episodes.lengths, np.floor(plans.scores[goals, ways][reached]))


def test_each_sweep_reaches_as_much_in_no_more_steps(found: tuple[Found, list[int]], tmp_path: Path) -> None:
    less, _ = search(tmp_path, BUDGET._replace(sweeps=2))
    more, reached = found
    assert reached == sorted(reached)
    assert reached[-1] == np.isfinite(more.lengths).sum() > 40
    assert (more.scores <= less.scores).all()
    assert more.scores.sum() < less.scores.sum()


def test_only_the_seed_changes_what_is_found(found: tuple[Found, list[int]], tmp_path: Path) -> None:
    for number, threads in enumerate((1, 2, 5)):
        (tmp_path / str(number)).mkdir()
        again, _ = search(tmp_path / str(number), threads=threads)
        np.testing.assert_array_equal(again.plans, found[0].plans)
    (tmp_path / "seed").mkdir()
    other, _ = search(tmp_path / "seed", seed=1)
    assert not np.array_equal(other.plans, found[0].plans)


def test_the_search_is_shorter_than_the_laws(found: tuple[Found, list[int]]) -> None:
    pursuit = fly_law(HARD, GRID.goals, PURSUIT)
    reached = (pursuit.last_events & 1) != 0
    assert (found[0].lengths[reached] <= pursuit.episodes.lengths).all()
    assert np.nanmean(found[0].lengths[reached]) < 0.9 * pursuit.episodes.lengths.mean()


def test_neighbours_are_next_along_each_axis_and_the_mirror_image() -> None:
    near = neighbours((2, 1, 3), symmetric=True)
    assert near.mirrored.tolist() == [False] * 6 + [True]
    assert near.goals[0].tolist() == [-1, 3, -1, -1, -1, 1, 2]
    assert near.goals[4].tolist() == [1, -1, -1, -1, 3, 5, 4]
    assert (neighbours((2, 1, 3), symmetric=False).goals[:, 6] == -1).all()


def test_what_cannot_be_searched_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="still conditions"):
        search_plans(Scenario(conditions=Conditions(wind_north=1.0)), GRID, BUDGET, tmp_path, seed=0)
    with pytest.raises(ValueError, match="control_mode='guidance'"):
        search_plans(Scenario(settings=sim.Settings("end_to_end")), GRID, BUDGET, tmp_path, seed=0)
    with pytest.raises(ValueError, match="ways must be 1 or 4, got 2"):
        search(tmp_path, BUDGET._replace(ways=2))
    with pytest.raises(ValueError, match="must be at least 1"):
        search(tmp_path, BUDGET._replace(population=0))


# Sets


def no_parent(name: str) -> Dataset:
    raise AssertionError(f"asked for {name}")


def fingerprints(folder: Path) -> dict[str, str]:
    return {path.name: hashlib.sha256(path.read_bytes()).hexdigest() for path in sorted(folder.iterdir())}


def make(folder: Path, **options: object) -> dict[str, str]:
    build_dataset(SMALL, folder, find_parent=no_parent, **options)
    return fingerprints(folder)


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("sets") / SMALL.name
    make(folder)
    return folder


def test_threads_shards_and_interruptions_change_no_byte(made: Path, tmp_path: Path) -> None:
    assert make(tmp_path / "a" / made.name, threads=1, shards=4) == fingerprints(made)
    folder = tmp_path / "b" / made.name
    told: list[int] = []

    def stop_in_the_third_sweep(done: int, _everything: int) -> None:
        told.append(done)
        if done == 3 * len(GRID.goals):
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        make(folder, progress=stop_in_the_third_sweep)
    assert not folder.exists()
    told.clear()
    assert make(folder, progress=lambda done, _: told.append(done)) == fingerprints(made)
    assert told[0] == 3 * len(GRID.goals)  # the first two sweeps were not flown again


def test_a_damaged_record_of_sweeps_is_made_anew(made: Path, tmp_path: Path) -> None:
    folder = tmp_path / made.name

    def stop(done: int, _everything: int) -> None:
        if done == 2 * len(GRID.goals):
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        make(folder, progress=stop)
    (record,) = tmp_path.glob(".*.build/sweeps.npz")
    record.write_bytes(record.read_bytes()[:-100])
    assert make(folder) == fingerprints(made)


def test_a_searched_set_says_how_it_was_found_and_flies_again(made: Path) -> None:
    stored = open_dataset(made)
    assert stored.manifest["specification"]["recipe"]["budget"] == BUDGET._asdict()
    assert stored.manifest["metrics"]["search"]["reached"][-1] == len(stored)
    assert stored.manifest["counts"]["goals_flown"] == 45
    assert set(stored.episode_column("source")) == {"search"}
    assert fly_again(stored.read()).passed


def test_mirrored_commands_are_flown(tmp_path: Path) -> None:
    specification = Specification("mirrored", "", HARD, Mirrored("search-sample-v0", resimulate=True))
    build_dataset(CATALOGUE["search-sample-v0"], tmp_path / "sample", find_parent=no_parent)
    sample = open_dataset(tmp_path / "sample")
    assert len(sample) > 0.95 * len(SAMPLE_GRID.goals)
    build_dataset(specification, tmp_path / "image", find_parent=lambda _: sample)
    image = open_dataset(tmp_path / "image")
    assert len(image) >= len(sample)
    assert image.lengths.sum() < sample.lengths.sum() + (len(image) - len(sample)) * 400
    assert image.manifest["metrics"]["mirror"]["shorter"] > 0
    assert fly_again(image.read()).passed


def test_several_ways_end_apart(tmp_path: Path) -> None:
    budget = BUDGET._replace(ways=4, patience=1.4)
    recipe = Searched(GoalGrid(Axis(200.0, 200.0, 1), Axis(0.0, 0.0, 1), Axis(150.0, 170.0, 3)), budget)
    folder = build_dataset(Specification("ways-v0", "", HARD, recipe), tmp_path / "ways", find_parent=no_parent)
    flights = open_dataset(folder).read()
    assert len(flights) > 3
    ends = np.stack([flights.final_observations[:, list(Observation._fields).index("altitude")] > 5000.0], axis=1)
    for goal in np.unique(flights.goals, axis=0):
        mine = (flights.goals == goal).all(axis=1)
        assert flights.lengths[mine].max() <= budget.patience * flights.lengths[mine].min()
    assert len(np.unique(ends)) == 2


def test_the_papers_sets_are_searched_under_the_papers_hard_task() -> None:
    for name in ("search-v0", "search-multi-v0", "pursuit-v0"):
        specification = CATALOGUE[name]
        assert specification.scenario.task == TASKS["hard"].task
        assert specification.recipe.grid == PAPER_GRID
