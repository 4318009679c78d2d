"""Mirror images, updates by others' flights, flying again, and differences between sets."""

import dataclasses

import numpy as np
import pytest

from vvc_bench.datasets.catalogue import CATALOGUE, PAPER_GRID, PID, SAMPLE_GRID, FlownByLaw, named_specification
from vvc_bench.datasets.merge import update
from vvc_bench.datasets.mirror import REFLOWN, fly_under, is_mirrored, mirror, mirror_and_fly
from vvc_bench.datasets.verify import difference, fly_again
from vvc_bench.experts import APPENDIX_C, WEIGHT_COMPENSATED, Goal, pid_command
from vvc_bench.experts.pid import TABLE_1
from vvc_bench.goals import SCALE
from vvc_bench.rollout import Episodes, Scenario, concatenate, fly_law, fly_policy
from vvc_bench.rollout.episodes import PER_EPISODE, PER_TRANSITION
from vvc_bench.sim.fields import GuidanceCommand, Observation, columns, field_array
from vvc_bench.tasks import make_task

GOALS = SAMPLE_GRID.goals


@pytest.fixture(scope="module")
def flown() -> Episodes:
    return fly_law(PID, GOALS, TABLE_1).episodes


def test_the_grid_is_the_papers() -> None:
    goals = PAPER_GRID.goals
    assert goals.shape == (50_715, 3)
    assert np.unique(goals, axis=0).shape == goals.shape
    np.testing.assert_array_equal(goals[0], [100, -85, -170])
    np.testing.assert_array_equal(goals[-1], [300, 85, 170])
    np.testing.assert_array_equal(np.diff(np.unique(goals[:, 0])), 10)
    np.testing.assert_array_equal(np.diff(np.unique(goals[:, 2])), 5)
    everything = {tuple(goal) for goal in goals.tolist()}
    assert all(tuple(goal) in everything for goal in GOALS.tolist())


def test_every_name_has_a_specification() -> None:
    for name, specification in CATALOGUE.items():
        assert named_specification(name).name == name
        assert specification.to_json()["name"] == name
        if isinstance(specification.recipe, FlownByLaw):
            assert Scenario.from_json(specification.scenario.to_json()) == specification.scenario
    with pytest.raises(ValueError, match=r"unknown set 'pid-v9'; did you mean pid-v0\?"):
        named_specification("pid-v9")


def test_mirroring_twice_changes_nothing(flown: Episodes) -> None:
    twice = mirror(mirror(flown))
    for name in (*PER_EPISODE, *PER_TRANSITION):
        if name != "sources":
            np.testing.assert_array_equal(getattr(twice, name), getattr(flown, name))


def test_the_mirror_image_has_the_signs_of_the_fields(flown: Episodes) -> None:
    """Every sign, observation and commands alike; the paper's own script leaves out half of them."""
    image = mirror(flown)
    names = list(columns(Observation))
    for name in ("roll_deg", "yaw_deg", "azimuth_deg", "roll_rate_degps"):
        np.testing.assert_array_equal(
            image.observations[:, names.index(name)], -flown.observations[:, names.index(name)]
        )
    for name in ("pitch_deg", "speed_mps", "path_angle_deg", "altitude_m"):
        np.testing.assert_array_equal(
            image.observations[:, names.index(name)], flown.observations[:, names.index(name)]
        )
    np.testing.assert_array_equal(image.goals, flown.goals * [1, 1, -1])
    np.testing.assert_array_equal(image.actions, flown.actions * np.float32([-1, 1, 1]))
    np.testing.assert_array_equal(image.deflections, flown.deflections * np.float32([-1, 1, -1, 1]))
    assert is_mirrored(image).all()


def test_not_every_mirrored_flight_is_one_that_the_aircraft_flies(flown: Episodes) -> None:
    """The tables are not exactly symmetric (docs/asymmetry.md), and long flights at 10 Hz amplify that."""
    reflown = mirror_and_fly(flown)
    assert len(flown) / 2 < len(reflown) < len(flown)
    assert reflown.reached.all()
    assert fly_again(reflown).passed
    wanted = {tuple(goal) for goal in (flown.goals * [1, 1, -1]).tolist()}
    assert {tuple(goal) for goal in reflown.goals.tolist()} <= wanted


def test_under_other_rules_flights_end_where_these_say(flown: Episodes) -> None:
    both = concatenate([flown, mirror(flown)])
    stricter = dataclasses.replace(flown.scenario, task=make_task(flown.scenario.task, direction_band_deg=0.5))
    kept = fly_under(both, stricter)
    assert 0 < len(kept) < len(both)
    assert kept.scenario == stricter
    assert kept.reached.all()
    assert not is_mirrored(kept).any()
    assert set(kept.sources.tolist()) == {"pid", f"pid{REFLOWN}"}
    assert fly_again(kept).passed
    assert len(fly_under(flown, flown.scenario)) == len(flown)


def test_updates_take_what_is_new_or_strictly_shorter(flown: Episodes) -> None:
    base = flown.select(np.arange(0, len(flown), 2))
    updated = update(base, flown)
    assert updated.new == len(flown) - len(base)
    assert updated.shorter == 0
    assert difference(updated.episodes, flown).same == len(flown)
    longer = dataclasses.replace(flown, sources=np.full(len(flown), "worse"))
    assert (update(flown, longer).episodes.sources == "pid").all()

    image = mirror(flown)
    both = update(flown, image)
    best: dict[tuple[float, ...], int] = {}
    for part in (flown, image):
        for goal, length in zip(part.goals.tolist(), part.lengths.tolist(), strict=True):
            best[tuple(goal)] = min(length, best.get(tuple(goal), length))
    assert dict(zip(map(tuple, both.episodes.goals.tolist()), both.episodes.lengths.tolist(), strict=True)) == best
    assert [tuple(goal) for goal in both.episodes.goals.tolist()] == sorted(best)
    assert both.shorter > 0


def test_updates_refuse_flights_that_fail(flown: Episodes) -> None:
    failed = dataclasses.replace(flown, events=np.zeros_like(flown.events))
    with pytest.raises(ValueError, match="episode 0 does not"):
        update(flown, failed)
    with pytest.raises(ValueError, match="same scenario"):
        update(flown, dataclasses.replace(flown, scenario=Scenario()))


def test_flying_again_finds_each_altered_value(flown: Episodes) -> None:
    assert fly_again(update(flown, mirror(flown)).episodes).passed
    rng = np.random.default_rng(0)
    for name in PER_TRANSITION:
        values = getattr(flown, name).copy()
        e = int(rng.integers(len(flown)))
        row = int(rng.integers(flown.offsets[e], flown.offsets[e + 1]))
        values.reshape(len(values), -1)[row, 0] += 1
        found = fly_again(dataclasses.replace(flown, **{name: values}))
        assert not found.passed
        assert {each.episode for each in found.divergences} == {e}
        if name != "actions":
            assert [(each.step, each.column) for each in found.divergences] == [(row - flown.offsets[e], name)]
        else:
            assert found.divergences[0].step >= row - flown.offsets[e]


def test_differences_name_the_goals(flown: Episodes) -> None:
    without_first, without_last = flown.select(np.arange(1, len(flown))), flown.select(np.arange(len(flown) - 1))
    found = difference(without_first, without_last)
    np.testing.assert_array_equal(found.gained, flown.goals[:1])
    np.testing.assert_array_equal(found.lost, flown.goals[-1:])
    assert found.same == len(flown) - 2
    other = difference(flown, fly_law(PID, GOALS, APPENDIX_C).episodes)
    assert len(other.shortened) > len(other.lengthened) > 0


def test_any_policy_flies_as_the_law_does() -> None:
    """The compiled loop and the loop over a policy agree to the last bit."""
    scenario = Scenario()
    goals = GOALS[::9]

    def law(observed: dict[str, np.ndarray]) -> np.ndarray:
        seen = observed["observation"] / field_array(Observation, "scale")
        wanted = observed["desired_goal"] / SCALE
        pairs = zip(seen.tolist(), wanted.tolist(), strict=True)
        commands = [pid_command(Observation(*each), Goal(*goal), WEIGHT_COMPENSATED) for each, goal in pairs]
        return np.array(commands) * field_array(GuidanceCommand, "scale")

    by_policy = fly_policy(scenario, goals, law, source="pid")
    by_law = fly_law(scenario, goals, WEIGHT_COMPENSATED)
    assert len(by_law.episodes) > 5
    np.testing.assert_array_equal(by_policy.last_events, by_law.last_events)
    for name in ("offsets", *PER_EPISODE, *PER_TRANSITION):
        np.testing.assert_array_equal(getattr(by_policy.episodes, name), getattr(by_law.episodes, name))


def test_parts_in_any_order_make_the_same_set(flown: Episodes) -> None:
    halves = flown.select(np.arange(len(flown)) % 2 == 0), flown.select(np.arange(len(flown)) % 2 == 1)
    one, other = (update(*pair).episodes for pair in (halves, halves[::-1]))
    np.testing.assert_array_equal(one.actions, other.actions)
    np.testing.assert_array_equal(one.actions, concatenate([flown]).actions)
