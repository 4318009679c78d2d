"""Policies of Stable-Baselines3 and imitation as ONNX files: trained here or elsewhere, they answer the same."""

import warnings
from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
import pytest
from gymnasium import spaces
from numpy.typing import NDArray

from vvc_bench import sim
from vvc_bench.envs.options import make_spaces
from vvc_bench.evaluation import evaluate, named_protocol
from vvc_bench.policies import open_agent, to_onnx
from vvc_bench.policies.trusted import load_stable_baselines

torch = pytest.importorskip("torch")
stable_baselines3 = pytest.importorskip("stable_baselines3")
pytest.importorskip("onnx")
pytest.importorskip("onnxruntime")

OURS = make_spaces(sim.Settings())
PARTS = {"achieved_goal": 3, "desired_goal": 3, "observation": 8}
AUTHORS = spaces.Dict({name: spaces.Box(0.0, 1.0, (width,), np.float32) for name, width in PARTS.items()})
UNIT = spaces.Box(0.0, 1.0, (3,), np.float32)
LOW = np.array([0, -90, -180, 0, -90, -180, -180, -90, -180, 0, -90, -180, -300, 0])
HIGH = np.array([1000, 90, 180, 1000, 90, 180, 180, 90, 180, 1000, 90, 180, 300, 20000])
"""flycraft 0.2.0's bounds of achieved goal, desired goal and observation, which its authors' policies scale from."""
ACTION_LOW, ACTION_HIGH = np.array([-180, -4, 0]), np.array([180, 9, 1])


class Stub(gymnasium.Env[Any, Any]):
    """An environment that is only asked for its spaces."""

    def __init__(self, observation_space: spaces.Space[Any], action_space: spaces.Space[Any]) -> None:
        self.observation_space, self.action_space = observation_space, action_space


def model_of(
    algorithm: str, observation_space: spaces.Space[Any], action_space: spaces.Space[Any], **policy_options: Any
) -> Any:
    kind = "MultiInputPolicy" if isinstance(observation_space, spaces.Dict) else "MlpPolicy"
    torch.manual_seed(0)
    with warnings.catch_warnings(action="ignore"):
        return getattr(stable_baselines3, algorithm)(
            kind,
            Stub(observation_space, action_space),
            device="cpu",
            policy_kwargs={"net_arch": [32, 32], **policy_options},
            **({"buffer_size": 10} if algorithm in ("SAC", "TD3", "DDPG") else {}),
        )


def observations(count: int = 64) -> dict[str, NDArray[np.float32]]:
    generator = np.random.default_rng(1)
    known: dict[str, Any] = dict(OURS.observation.spaces)  # type: ignore[attr-defined]
    return {
        name: box.low + (box.high - box.low) * generator.random((count, *box.shape), dtype=np.float32)
        for name, box in known.items()
    }


def answers(path: Path, seen: dict[str, NDArray[np.float32]]) -> NDArray[np.float32]:
    return np.asarray(open_agent(str(path)).begin(np.arange(64))(seen))


def assert_alike(found: Any, expected: NDArray[Any]) -> None:
    """To a hundredth of how much answers differ from one observation to another."""
    assert (np.abs(np.asarray(found) - expected).max(axis=0) < 0.01 * expected.std(axis=0)).all()


@pytest.mark.parametrize("algorithm", ["PPO", "A2C", "SAC", "TD3", "DDPG"])
def test_a_policy_for_our_environments(algorithm: str, tmp_path: Path) -> None:
    model = model_of(algorithm, OURS.observation, OURS.action)
    for layer in model.policy.modules():
        if isinstance(layer, torch.nn.Linear) and layer.in_features == sum(PARTS.values()):
            layer.weight.data *= 1e-3  # of altitudes in metres; else nothing but bounds comes out
    seen = observations()
    expected, _ = model.predict(seen, deterministic=True)
    found = answers(to_onnx(model, tmp_path / "policy.onnx"), seen)
    assert_alike(found, expected)


@pytest.mark.parametrize("algorithm", ["PPO", "SAC"])
@pytest.mark.parametrize("flat", [False, True])
def test_a_policy_of_the_authors_shape(algorithm: str, flat: bool, tmp_path: Path) -> None:
    seen_as = spaces.Box(0.0, 1.0, (14,), np.float32) if flat else AUTHORS
    model = model_of(algorithm, seen_as, UNIT, activation_fn=torch.nn.Tanh)
    seen = observations()
    together = np.concatenate([seen[name] for name in PARTS], axis=1)
    scaled = ((together - LOW) / (HIGH - LOW)).astype(np.float32)
    shown = scaled if flat else dict(zip(PARTS, np.split(scaled, [3, 6], axis=1), strict=True))
    answer, _ = model.predict(shown, deterministic=True)
    expected = ACTION_LOW + answer * (ACTION_HIGH - ACTION_LOW)
    assert_alike(answers(to_onnx(model, tmp_path / "policy.onnx"), seen), expected)
    model.save(tmp_path / "theirs.zip")
    trusted = open_agent(str(tmp_path / "theirs.zip"), trust=True)
    assert_alike(trusted.begin(np.arange(64))(seen), expected)
    to_onnx(load_stable_baselines(tmp_path / "theirs.zip"), tmp_path / "again.onnx")
    assert (tmp_path / "again.onnx").read_bytes() == (tmp_path / "policy.onnx").read_bytes()


def test_an_imitation_policy_with_normalised_features(tmp_path: Path) -> None:
    imitation = pytest.importorskip("imitation.policies.base")
    policies = pytest.importorskip("stable_baselines3.common.policies")
    flat = spaces.flatten_space(OURS.observation)
    torch.manual_seed(0)
    policy = policies.ActorCriticPolicy(
        flat, OURS.action, lambda _: 0.0, features_extractor_class=imitation.NormalizeFeaturesExtractor
    )
    seen = observations()
    together = np.concatenate([seen[name] for name in PARTS], axis=1)
    policy.set_training_mode(True)
    for _ in range(3):
        policy.extract_features(torch.as_tensor(together))  # the running mean and variance
    expected, _ = policy.predict(together, deterministic=True)
    found = answers(to_onnx(policy, tmp_path / "policy.onnx"), seen)
    assert_alike(found, expected)


def test_four_components_are_the_surfaces(tmp_path: Path) -> None:
    action = make_spaces(sim.Settings("end_to_end")).action
    found = answers(to_onnx(model_of("SAC", OURS.observation, action), tmp_path / "policy.onnx"), observations())
    assert found.shape == (64, 4)
    assert all(each in action for each in found)


@pytest.mark.parametrize("activation", ["ReLU", "ELU", "LeakyReLU", "SiLU", "Sigmoid", "Softplus"])
def test_activations(activation: str, tmp_path: Path) -> None:
    model = model_of("TD3", AUTHORS, UNIT, activation_fn=getattr(torch.nn, activation))
    to_onnx(model, tmp_path / "policy.onnx")  # checks itself; the next test shows that the check can fail


def test_a_file_that_answers_otherwise_is_not_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    model = model_of("TD3", AUTHORS, UNIT)
    predict = type(model.policy).predict

    def otherwise(*arguments: Any, **options: Any) -> Any:
        answer, state = predict(*arguments, **options)
        return answer + 0.001, state

    monkeypatch.setattr(type(model.policy), "predict", otherwise)
    with pytest.raises(ValueError, match="answers otherwise"):
        to_onnx(model, tmp_path / "policy.onnx")
    assert not list(tmp_path.iterdir())


def test_what_cannot_be_converted_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "policy.onnx"
    with pytest.raises(ValueError, match="a layer GELU is none"):
        to_onnx(model_of("TD3", AUTHORS, UNIT, activation_fn=torch.nn.GELU), path)
    unbounded = spaces.Box(-np.inf, np.inf, (14,), np.float32)
    with pytest.raises(ValueError, match="finite bounds"):
        to_onnx(model_of("PPO", unbounded, UNIT), path)
    with pytest.raises(ValueError, match="must see 14 values, not 11"):
        to_onnx(model_of("PPO", spaces.Box(0.0, 1.0, (11,), np.float32), UNIT), path)
    with pytest.raises(ValueError, match="3 or 4 components"):
        to_onnx(model_of("PPO", AUTHORS, spaces.Box(0.0, 1.0, (2,), np.float32)), path)
    with pytest.raises(ValueError, match="is no policy"):
        to_onnx(torch.nn.Linear(3, 3), path)
    assert not path.exists()


def test_a_zip_that_holds_no_model_is_refused(tmp_path: Path) -> None:
    (tmp_path / "model.zip").write_bytes(b"nothing")
    with pytest.raises(ValueError, match="no Stable-Baselines3 model"):
        open_agent(str(tmp_path / "model.zip"), trust=True)


@pytest.mark.filterwarnings("ignore:`torch.jit")
def test_a_torchscript_module_is_asked_for_actions(tmp_path: Path) -> None:
    class Module(torch.nn.Module):  # type: ignore[misc, name-defined]
        def forward(self, observation: Any, achieved_goal: Any, desired_goal: Any) -> Any:
            return 0.1 * (desired_goal - achieved_goal) + observation[:, :3]

    seen = observations()
    traced = torch.jit.trace(
        Module(), tuple(torch.from_numpy(seen[key]) for key in ("observation", "achieved_goal", "desired_goal"))
    )
    traced.save(str(tmp_path / "module.pt"))
    agent = open_agent(str(tmp_path / "module.pt"), trust=True)
    expected = np.float32(0.1) * (seen["desired_goal"] - seen["achieved_goal"]) + seen["observation"][:, :3]
    np.testing.assert_allclose(agent.begin(np.arange(64))(seen), expected, rtol=1e-5)
    (tmp_path / "broken.pt").write_bytes(b"nothing")
    with pytest.raises(ValueError, match="no TorchScript module"):
        open_agent(str(tmp_path / "broken.pt"), trust=True)


def test_a_model_flies_the_same_as_itself_and_as_onnx(tmp_path: Path) -> None:
    model = model_of("PPO", OURS.observation, OURS.action)
    model.save(tmp_path / "model.zip")
    to_onnx(model, tmp_path / "model.onnx")
    protocol = named_protocol("normal-1k-v0")
    flights = [
        evaluate(open_agent(str(tmp_path / name), trust=True), protocol).episodes
        for name in ("model.zip", "model.onnx")
    ]
    assert (flights[0]["termination"] == flights[1]["termination"]).mean() > 0.98
