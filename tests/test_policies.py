"""Policies are opened, refused with what was found, and answer as what they were made from."""

import sys
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray
from onnx import helper
from small_policies import BIAS, INPUTS, linear_law, write_linear, write_model, write_network, write_recurrent

from vvc_bench import sim
from vvc_bench.datasets.catalogue import CATALOGUE, Updated
from vvc_bench.envs.options import make_spaces
from vvc_bench.leaderboard.model import check_model
from vvc_bench.policies import open_agent, opening
from vvc_bench.policies.onnx import LARGEST_FILE
from vvc_bench.policies.trained import TRAINED, find_trained, open_trained

SEEDS = np.arange(4)


def observations(count: int = 4) -> dict[str, NDArray[np.float32]]:
    generator = np.random.default_rng(1)
    spaces = make_spaces(sim.Settings()).observation.spaces  # type: ignore[attr-defined]
    return {
        name: box.low + (box.high - box.low) * generator.random((count, *box.shape), dtype=np.float32)
        for name, box in spaces.items()
    }


def test_an_onnx_policy_answers_as_its_numbers_say(tmp_path: Path) -> None:
    agent = open_agent(str(write_linear(tmp_path / "mine.onnx")))
    seen = observations()
    together = np.concatenate([seen["observation"], seen["desired_goal"]], axis=1)
    np.testing.assert_allclose(agent.begin(SEEDS)(seen), together @ linear_law() + BIAS, rtol=1e-4, atol=1e-2)
    described = agent.describe()
    assert (described["kind"], described["name"], agent.name) == ("onnx", "mine", "mine")
    assert described["sha256"] is not None
    assert len(described["sha256"]) == 64


def test_the_same_batch_gives_the_same_bits_in_another_session(tmp_path: Path) -> None:
    path = write_network(tmp_path / "network.onnx")
    seen = observations(256)
    seeds = np.arange(256)
    first, second = (np.asarray(open_agent(str(path)).begin(seeds)(seen)) for _ in range(2))
    assert first.tobytes() == second.tobytes()


def test_a_recurrent_policy_keeps_its_own_state_from_step_to_step(tmp_path: Path) -> None:
    agent = open_agent(str(write_recurrent(tmp_path / "memory.onnx")))
    seen = observations()
    policy, later = agent.begin(SEEDS), agent.begin(SEEDS)
    throttles = [np.asarray(policy(seen))[0, 2] for _ in range(8)]
    assert np.diff(throttles).round(3).tolist() == [0.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0]
    assert np.asarray(later(seen))[0, 2] == throttles[0]


@pytest.mark.parametrize(
    ("inputs", "outputs", "batch", "message"),
    [
        ({"observation": 8}, {"action": 3}, "B", "inputs must be observation, desired_goal"),
        ({**INPUTS, "camera": 3}, {"action": 3}, "B", "it has camera"),
        (INPUTS, {"command": 3}, "B", "outputs must be action.*it has command"),
        ({"observation": 9, "desired_goal": 3}, {"action": 3}, "B", r"shape \(B, 8\).*\(B, 9\)"),
        (INPUTS, {"action": 5}, "B", r"shape \(B, 3 or 4\)"),
        (INPUTS, {"action": 3}, 1, "free B"),
        ({**INPUTS, "state": 2}, {"action": 3}, "B", "next_state"),
    ],
)
def test_other_inputs_and_outputs_are_refused_with_what_was_found(
    tmp_path: Path, inputs: dict[str, int], outputs: dict[str, int], batch: str | int, message: str
) -> None:
    width = sum(inputs.values())
    (name, size), *_ = outputs.items()
    nodes = [
        helper.make_node("Concat", list(inputs), ["seen"], axis=1),
        helper.make_node("MatMul", ["seen", "law"], [name]),
    ]
    law = {"law": np.zeros((width, size), dtype=np.float32)}
    path = write_model(tmp_path / "odd.onnx", nodes, law, inputs, outputs, batch)
    with pytest.raises(ValueError, match=message):
        open_agent(str(path))


def test_files_that_are_no_policies_are_refused(tmp_path: Path) -> None:
    broken = tmp_path / "broken.onnx"
    broken.write_bytes(b"not a model")
    with pytest.raises(ValueError, match="no ONNX model"):
        open_agent(str(broken))
    with broken.open("wb") as file:
        file.truncate(LARGEST_FILE + 1)
    with pytest.raises(ValueError, match="at most"):
        open_agent(str(broken))
    with pytest.raises(FileNotFoundError, match=r"missing\.onnx"):
        open_agent(str(tmp_path / "missing.onnx"))
    with pytest.raises(ValueError, match="unknown policy 'pit': give one of pid"):
        open_agent("pit")


def test_code_runs_only_where_it_is_trusted(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    (tmp_path / "hers.py").write_text(
        "import numpy\n"
        "OPENED = True\n"
        "def factory():\n"
        "    return lambda seen: numpy.ones((len(seen['observation']), 3))\n"
        "def number():\n"
        "    return 3\n"
    )
    monkeypatch.chdir(tmp_path)
    for policy in ("hers:factory", "model.zip", "model.pt"):
        with pytest.raises(ValueError, match="--trust"):
            open_agent(policy)
    assert "hers" not in sys.modules
    agent = open_agent("hers:factory", trust=True)
    assert np.asarray(agent.begin(SEEDS)(observations())).shape == (4, 3)
    assert agent.describe() == {"kind": "python", "name": "hers:factory", "sha256": None}
    with pytest.raises(ValueError, match="must return an agent"):
        open_agent("hers:number", trust=True)
    with pytest.raises(ValueError, match="must be module:factory"):
        open_agent("hers:nothing", trust=True)


def test_random_actions_fill_the_space_and_depend_on_the_aircrafts_seed_alone() -> None:
    settings = sim.Settings("end_to_end")
    agent, space = open_agent("random", settings=settings), make_spaces(settings).action
    policy, alone = agent.begin(np.array([7, 8, 9])), agent.begin(np.array([8]))
    drawn = np.array([policy({}) for _ in range(300)])
    assert drawn.shape == (300, 3, 4)
    assert np.array_equal(drawn[:, 1], np.array([alone({}) for _ in range(300)])[:, 0])
    assert all(action in space for action in drawn[:, 0])
    assert np.abs(drawn.mean(axis=(0, 1))[:3]).max() < 3.0
    assert len(np.unique(drawn[:, :, 0])) > 800


def test_the_guidance_law_does_not_command_surfaces() -> None:
    with pytest.raises(ValueError, match="cannot fly 'end_to_end'"):
        open_agent("pid", settings=sim.Settings("end_to_end"))


def test_trained_policies_are_those_that_the_sets_name() -> None:
    for name in TRAINED:
        agent = open_agent(name)
        assert find_trained(agent.sha256).name == name
        recipe = CATALOGUE[f"{name.split('-')[0]}-v0"].recipe
        assert isinstance(recipe, Updated)
        assert f"sha256:{agent.sha256}" in recipe.policies
        check_model((Path(opening.__file__).parent / "models" / f"{name}.onnx").read_bytes())
    with pytest.raises(ValueError, match="unknown trained policy 'irpo0'; known are irpo1"):
        open_trained("irpo0")
    with pytest.raises(ValueError, match="no policy of the package has the SHA-256 00"):
        find_trained("00")
