"""Protocols never change, are the same for everyone, and held-out goals cannot be known."""

import hashlib

import numpy as np
import pytest

from vvc_bench.datasets.catalogue import PAPER_GRID
from vvc_bench.evaluation import PROTOCOLS, held_out, named_protocol
from vvc_bench.tasks import TASKS

FROZEN = {
    "normal-1k-v0": "5dd24bd0d3c6407f7da6add9904b0e8e9d4731c37f7b22e35921afbd8bcb0677",
    "normal-end-to-end-1k-v0": "2ac92e08081c0ce4518a16a7aab4612e663511784010f47d255cc989459f959a",
    "normal-validation-v0": "ee8200d76f77002659ecab40df75b058787f636f8addaa00b281486680496f71",
    "normal-end-to-end-validation-v0": "8355d90561d8bb3e28d1aabbbea926f8194c8c717bf4a78d3311215e39b9d110",
    "normal-sets-validation-v0": "27d6fd6943d882da0ce1d28e274568200e87401d8c3cbb1e1559d286c45fb1ec",
    "medium-1k-v0": "687ed6d4711dcfeedf6deb781c7189e50e2ab31aeb995201febd059776bce1a3",
    "medium-end-to-end-1k-v0": "0d0158425dfca6067d337b43671ef05d48d00b7fdbb641529adef28e2d53d251",
    "medium-validation-v0": "5bd7aae4f73025c9130a4cfa375ffb397bcdc72c856b04b723b2f757a30dece4",
    "medium-end-to-end-validation-v0": "bbdc036b66b66b7cf6f75194d011361e9e18b81a537b36d53866ae4f7d0e3e2d",
    "medium-sets-validation-v0": "633d874f8065e08a8879800cc02131b32f6693d444e2809dd71df66607653ebf",
    "hard-1k-v0": "aa4ea270c6efcf3cf8e6855ce414c5041887b714e565747b29cd2d6f3435b6a0",
    "hard-end-to-end-1k-v0": "ef1229d771321ae1f7bedce64f1a726a73632c2b169a9a11517618ccc5bfc733",
    "hard-validation-v0": "5075e12cb0a1a0a3e8f4e55cf954f7c9ac483cccb9967eb1e885fbabe6faabbe",
    "hard-end-to-end-validation-v0": "0afde2b60c1cd1c03990ad5b1e8335418f94337ba15751b67d3cf0d9a8580afa",
    "hard-sets-validation-v0": "44f26b2789d65eefe44e6e1d8affa6697f06176cc376d82a8cc07b3d6d977676",
    "hard-grid-v0": "ea0a7b5608ce08c4d2f153229bb24d56f533af9e061212a3c4e8263966933e72",
    "hard-nmr1-1k-v0": "179f535c88d971de94eb96958b98932646d0dd28cdaa93472666fb617ae0aa47",
    "hard-nmr10-1k-v0": "aa4ea270c6efcf3cf8e6855ce414c5041887b714e565747b29cd2d6f3435b6a0",
    "hard-nmr20-1k-v0": "0670a00f3311bfb04a3c67eb5dc21894fcdf2e34be540b6c4d82c8260a5e6b9a",
    "hard-nmr30-1k-v0": "b7b91ff8dfca669fa81db60fbb0ab2e065fc44bc03bdbe39463a0f5ebf047a95",
    "turn-climb-v0": "1055d08265d5be743e19ebcb0048dd98f3c5d1e161b47ec433b875e3c91051f4",
    "robust-wind-1k-v0": "7910c9f85161030c752a2dba8512af0dac3a83c6cb3825b1b17fca4195077657",
    "robust-gusts-1k-v0": "9a3d50a8c3684a9f2c2833806b4f26415f75daacb0f3b525c94bcab367e3e833",
    "robust-density-1k-v0": "0a64a2eea3921f6e0d6db126d6affab551b27cdb0558f320667df5d2d3d441f5",
    "robust-mass-1k-v0": "49666c2a3911a6e825304c953abc6510c890c61bc1fdd7bb5c45b2e6788eae9a",
    "robust-actuator-1k-v0": "09641c54f59a9c407a1738fa100ff0d12585a91421b745fc05529b4a758cc5d4",
    "robust-delay-1k-v0": "d7a21aeda73271d72c6160416ab867e9d401bb2899a88e8bed5a2b197dc1a220",
    "robust-noise-1k-v0": "b139d57eef173bebe8ef1278c6023ce07af1e06c7ac2859eb99ed60d40b2f4e7",
    "robust-all-1k-v0": "2d2685e21f232e3b5e3a96c6046f6ba0dab332eb72487ba51a4fb135d042ad50",
}
"""What each name stands for. A hash that changes breaks every result under that name: make a new version instead."""


def test_every_protocol_is_what_its_name_has_always_meant() -> None:
    assert {name: protocol.hash for name, protocol in PROTOCOLS.items()} == FROZEN


@pytest.mark.parametrize("task", ["normal", "medium", "hard"])
def test_goals_fill_the_box_and_survive_float32(task: str) -> None:
    goals = named_protocol(f"{task}-1k-v0").goals
    low, high = np.array(TASKS[task].goals.low), np.array(TASKS[task].goals.high)
    assert goals.shape == (1000, 3)
    assert (goals >= low).all()
    assert (goals <= high).all()
    assert np.array_equal(goals, goals.astype(np.float32))
    share = (goals - low) / (high - low)
    assert np.abs(share.mean(axis=0) - 0.5).max() < 3 * np.sqrt(1 / 12 / 1000)
    assert np.abs(np.corrcoef(share.T) - np.eye(3)).max() < 0.1


def test_the_grid_is_the_papers() -> None:
    assert np.array_equal(named_protocol("hard-grid-v0").goals, PAPER_GRID.goals)
    assert len(named_protocol("hard-grid-v0")) == 50_715


def test_robust_and_held_protocols_have_the_goals_and_seeds_of_the_plain_one() -> None:
    plain = named_protocol("hard-1k-v0")
    for name, protocol in PROTOCOLS.items():
        if name.startswith(("robust-", "hard-nmr")):
            assert np.array_equal(protocol.goals, plain.goals), name
        assert np.array_equal(protocol.seeds[:1000], plain.seeds), name


def test_validation_goals_are_others() -> None:
    for task in ("normal", "medium", "hard"):
        test, validation = named_protocol(f"{task}-1k-v0"), named_protocol(f"{task}-validation-v0")
        assert not set(map(tuple, test.goals.tolist())) & set(map(tuple, validation.goals.tolist()))


def test_robust_protocols_differ_from_the_plain_one_in_what_they_say() -> None:
    def changed(name: str) -> set[str]:
        still = named_protocol("hard-1k-v0").conditions[0]._asdict()
        conditions = named_protocol(name).conditions
        return {field for each in conditions for field, value in each._asdict().items() if value != still[field]}

    assert changed("robust-wind-1k-v0") == {"wind_north", "wind_east"}
    assert changed("robust-gusts-1k-v0") == {"gust_intensity"}
    assert changed("robust-density-1k-v0") == {"density_offset"}
    assert changed("robust-mass-1k-v0") == {"mass_offset"}
    assert changed("robust-actuator-1k-v0") == {
        "actuator_time_constant",
        "actuator_rate_limit",
        "engine_time_constant",
    }
    assert changed("robust-delay-1k-v0") == {"delay_steps"}
    assert changed("robust-noise-1k-v0") == {"sensor_noise"}
    every = {field for name in PROTOCOLS if name.startswith("robust-") and "all" not in name for field in changed(name)}
    assert changed("robust-all-1k-v0") == every


def test_episode_seeds_depend_on_the_seed_and_fit_what_they_are_stored_in() -> None:
    protocol = named_protocol("hard-1k-v0")
    assert not np.array_equal(protocol.episode_seeds(0), protocol.episode_seeds(1))
    assert len(np.unique(protocol.seeds)) == 1000
    assert np.array_equal(protocol.seeds.astype(np.float64).astype(np.int64), protocol.seeds)
    with pytest.raises(ValueError, match="negative"):
        protocol.episode_seeds(-1)


@pytest.mark.parametrize("name", ["hard-1k-v0", "hard-grid-v0", "turn-climb-v0"])
def test_held_out_goals_depend_on_the_submission_and_on_the_announced_seed(name: str) -> None:
    protocol = named_protocol(name)
    one, other = (hashlib.sha256(text).hexdigest() for text in (b"one", b"other"))
    drawn = [held_out(protocol, *key) for key in ((one, 1), (one, 2), (other, 1), (one, 1))]
    points = [each.goals if each.starts is None else each.starts for each in drawn]
    assert np.array_equal(points[0], points[3])
    assert drawn[0].hash == drawn[3].hash
    for a, b in ((0, 1), (0, 2), (1, 2)):
        assert not set(map(tuple, points[a].tolist())) & set(map(tuple, points[b].tolist()))
    assert drawn[0].scenario == protocol.scenario
    assert len(drawn[0]) == 1000
    assert drawn[0].name not in PROTOCOLS


def test_bad_names_and_hashes_are_refused_helpfully() -> None:
    with pytest.raises(ValueError, match="did you mean hard-1k-v0"):
        named_protocol("hard-1k")
    with pytest.raises(ValueError, match="64 hexadecimal digits"):
        held_out(named_protocol("hard-1k-v0"), "abc", 1)
