"""The baselines learn, go on after they were stopped as if they had not been, and become ONNX files that act alike."""

import dataclasses
import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

pytest.importorskip("torch", reason="PyTorch is not installed: pip install vvc-bench[train]")
pytest.importorskip("imitation", reason="imitation is not installed: pip install vvc-bench[train]")
pytest.importorskip("onnxruntime", reason="onnxruntime is not installed: pip install vvc-bench[train]")

import torch
from small_flights import flights
from stable_baselines3.common.logger import Logger

from vvc_bench import sim
from vvc_bench.baselines.actors import LogisticTanh, make_policy
from vvc_bench.baselines.configurations import (
    CONFIGURATIONS,
    CURRICULA,
    GCBC_SMALL,
    PPO_SMALL,
    SAC_SMALL,
    STAGED,
    PpoConfiguration,
    StagedConfiguration,
    amount_of,
    with_amount,
)
from vvc_bench.baselines.curricula import ACHIEVED, Curriculum, Intermediate, make_curriculum
from vvc_bench.baselines.devices import find_device
from vvc_bench.baselines.features import ANTISYMMETRIC, FEATURES, RelativeFeatures
from vvc_bench.baselines.gcbc import Cloning
from vvc_bench.baselines.irpo import SUMMARY, train_irpo
from vvc_bench.baselines.ppo import Improving
from vvc_bench.baselines.recipes import Setting, make_environments, train_gcbc, train_gcbc_ppo, train_ppo
from vvc_bench.baselines.sac import SoftActorCritic
from vvc_bench.baselines.training import (
    BEST_POLICY,
    LAST,
    POLICY,
    TRAINING,
    deterministic,
    read_training,
    weights_sha256,
)
from vvc_bench.baselines.unit_actions import UnitActions, from_unit, to_unit, unit_box
from vvc_bench.cli import main
from vvc_bench.datasets.catalogue import LEARNED, SAMPLE_GRID
from vvc_bench.datasets.dataset import Dataset
from vvc_bench.datasets.folders import locked
from vvc_bench.datasets.mirror import fly_under
from vvc_bench.datasets.sources import load_dataset
from vvc_bench.datasets.store import Description, open_dataset, write_dataset
from vvc_bench.datasets.transitions import transitions_of
from vvc_bench.datasets.verify import fly_again
from vvc_bench.envs.options import make_spaces
from vvc_bench.envs.stable_baselines import VelocityVectorVecEnv
from vvc_bench.evaluation import named_protocol
from vvc_bench.goals import UniformBox
from vvc_bench.policies import open_agent, to_onnx
from vvc_bench.rollout import Episodes, Scenario, fly_policy
from vvc_bench.sim.fields import Goal, Observation, field_array
from vvc_bench.tasks import TASKS, make_task

WHERE = make_spaces(sim.Settings())
BOUNDS: Any = WHERE.action
SILENT = Logger(None, [])
EASY = UniformBox((195.0, -5.0, -10.0), (205.0, 5.0, 10.0))

TINY_PPO = PPO_SMALL._replace(environments=16, steps_of_a_rollout=32, batch_size=256, epochs=2, steps=5000)
TINY_SAC = SAC_SMALL._replace(environments=4, batch_size=32, learning_starts=200, buffer_size=20_000, gradient_steps=1)


@pytest.fixture(scope="module", autouse=True)
def _one_thread() -> None:
    torch.set_num_threads(1)


@pytest.fixture(scope="module")
def flown() -> Episodes:
    return flights()


@pytest.fixture(scope="module")
def small_set(flown: Episodes, tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    folder = tmp_path_factory.mktemp("sets") / "small"
    return open_dataset(write_dataset(folder, flown, Description("small")))


def observations(count: int, seed: int = 0) -> dict[str, np.ndarray]:
    generator = np.random.default_rng(seed)
    drawn: dict[str, np.ndarray] = {}
    for name, box in WHERE.observation.spaces.items():  # type: ignore[attr-defined]
        drawn[name] = (box.low + (box.high - box.low) * generator.random((count, *box.shape))).astype(np.float32)
    return drawn


def policy_of(hidden: tuple[int, ...] = (16, 16), seed: int = 0) -> Any:
    torch.manual_seed(seed)
    return make_policy(WHERE.observation, unit_box(BOUNDS), hidden, lambda _: 0.0)


def easy_environments(count: int, **fields: object) -> UnitActions:
    return UnitActions(VelocityVectorVecEnv("VVC/Normal-v0", count, seed=1, threads=1, goals=EASY, **fields))


def mean_return(policy: Any, count: int = 64, **fields: object) -> float:
    """Of deterministic flights to easy goals, failures included."""
    environments = easy_environments(count, **fields)
    observed, act = environments.venv.reset(), deterministic(policy).function
    returns, flying = np.zeros(count), np.ones(count, dtype=bool)
    while flying.any():
        observed, rewards, dones, _ = environments.venv.step(act(observed))
        returns += rewards * flying
        flying &= ~dones
    return float(returns.mean())


# What a policy sees and answers


def features_of(observed: dict[str, np.ndarray]) -> np.ndarray:
    with torch.no_grad():
        made = RelativeFeatures(WHERE.observation)({name: torch.from_numpy(each) for name, each in observed.items()})
    return made.numpy()


def test_features_do_not_depend_on_where_north_is() -> None:
    observed = observations(500)
    turned = {name: values.copy() for name, values in observed.items()}
    for name in (Observation._fields.index("yaw"), Observation._fields.index("azimuth")):
        turned["observation"][:, name] = (turned["observation"][:, name] + 77.0 + 180.0) % 360.0 - 180.0
    azimuth = Goal._fields.index("azimuth")
    turned["desired_goal"][:, azimuth] = (turned["desired_goal"][:, azimuth] + 77.0 + 180.0) % 360.0 - 180.0
    np.testing.assert_allclose(features_of(turned), features_of(observed), atol=1e-4)
    turned["desired_goal"][:, azimuth] += 5.0
    assert np.abs(features_of(turned) - features_of(observed)).max() > 0.05


def test_features_of_mirror_images_change_signs_or_stay() -> None:
    observed = observations(500)
    image = {
        "observation": observed["observation"] * field_array(Observation, "mirror").astype(np.float32),
        "desired_goal": observed["desired_goal"] * field_array(Goal, "mirror").astype(np.float32),
    }
    signs = np.ones(FEATURES)
    signs[list(ANTISYMMETRIC)] = -1.0
    np.testing.assert_allclose(features_of(image), features_of(observed) * signs, atol=1e-5)
    assert (np.abs(features_of(observed)).max(axis=0) > 0.1).all()


def test_features_show_the_goal_as_the_pilot_sees_it() -> None:
    observed = {
        "observation": np.float32([[90, 0, 0, 200, 0, 0, 0, 5000]]),  # banked to the right, level, heading north
        "desired_goal": np.float32([[220, 0, 90]]),  # to the east
    }
    ahead, right, up, towards_lift, across_lift = features_of(observed)[0, :5]
    np.testing.assert_allclose([ahead, right, up, towards_lift, across_lift], [0, 1, 0, 1, 0], atol=1e-6)


def test_unit_actions_and_back() -> None:
    actions = BOUNDS.low + (BOUNDS.high - BOUNDS.low) * np.random.default_rng(0).random((100, 3), dtype=np.float32)
    unit = to_unit(actions, BOUNDS)
    assert unit.min() >= -1.0
    assert unit.max() <= 1.0
    np.testing.assert_allclose(from_unit(unit, BOUNDS), actions, atol=1e-4)
    np.testing.assert_array_equal(from_unit(np.float32([[-1, -1, -1], [1, 1, 1]]), BOUNDS), [BOUNDS.low, BOUNDS.high])


def sac_policy() -> Any:
    return SoftActorCritic(easy_environments(4), TINY_SAC, 0).policy


@pytest.mark.parametrize("make", [lambda: policy_of((128, 128)), lambda: policy_of((32, 16, 8), 3), sac_policy])
def test_a_policy_as_onnx_acts_as_the_library_does(make: Callable[[], Any], tmp_path: Path) -> None:
    policy = make()
    observed = observations(10_000, seed=5)
    path = to_onnx(policy, tmp_path / "policy.onnx")
    found = np.asarray(open_agent(str(path)).begin(np.zeros(10_000, dtype=np.int64))(observed))
    unit, _ = policy.predict(observed, deterministic=True)
    expected = from_unit(unit, BOUNDS)
    assert np.abs(to_unit(found, BOUNDS) - unit).max() < 1e-5
    np.testing.assert_array_equal(deterministic(policy).function(observed), expected)
    assert np.ptp(expected, axis=0).min() > 0.01


def test_tanh_and_its_slope_are_pytorchs() -> None:
    x = torch.cat([torch.linspace(-30.0, 30.0, 100_001), torch.tensor([0.0, 1e-9, -1e-4, torch.inf, -torch.inf])])
    mine, theirs = (x.clone().requires_grad_() for _ in range(2))
    values = LogisticTanh()(mine), torch.tanh(theirs)
    for value in values:
        value.sum().backward()
    assert mine.grad is not None
    assert theirs.grad is not None
    assert float((values[0] - values[1]).detach().abs().max()) < 2e-7
    assert float((mine.grad - theirs.grad).abs().max()) < 5e-7
    assert torch.isnan(LogisticTanh()(torch.tensor(torch.nan)))


# KL to the demonstrator


def test_the_penalty_is_the_divergence_from_the_demonstrator() -> None:
    demonstrator, mine = policy_of(seed=1), policy_of(seed=2)
    with torch.no_grad():
        demonstrator.log_std += torch.tensor([-0.5, 0.2, -1.0])
        for parameter in (*mine.action_net.parameters(), *demonstrator.action_net.parameters()):
            parameter *= 30.0  # else all means are near 0
    observed = {name: torch.from_numpy(values) for name, values in observations(300).items()}
    mine.penalty = 0.7
    mine.follow(demonstrator)
    actions = torch.zeros((300, 3))
    _, _, bonus = mine.evaluate_actions(observed, actions)

    def mean_and_std(policy: Any) -> tuple[torch.Tensor, torch.Tensor]:
        latent = policy.mlp_extractor.forward_actor(policy.extract_features(observed))
        return policy.action_net(latent), policy.log_std.exp()

    (shown, shown_std), (mean, std) = mean_and_std(demonstrator), mean_and_std(mine)
    divergence = torch.log(std / shown_std) + (shown_std**2 + (shown - mean) ** 2) / (2 * std**2) - 0.5
    assert divergence.mean() > 0.1
    torch.testing.assert_close(-bonus.mean(), 0.7 * divergence.mean(), rtol=1e-5, atol=1e-6)
    # what PPO minimises has ent_coef · −mean(entropy): its gradient is that of λ · KL
    for expected, found in zip(
        torch.autograd.grad(0.7 * divergence.mean(), mine.actor_parameters, retain_graph=True),
        torch.autograd.grad(-bonus.mean(), mine.actor_parameters),
        strict=True,
    ):
        torch.testing.assert_close(found, expected, rtol=1e-4, atol=1e-6)


def test_without_a_penalty_there_is_the_entropy_alone() -> None:
    policy = policy_of()
    policy.entropy_weight = 0.3
    policy.follow(policy_of(seed=1))
    observed = {name: torch.from_numpy(values) for name, values in observations(50).items()}
    _, _, bonus = policy.evaluate_actions(observed, torch.zeros((50, 3)))
    entropy = policy.get_distribution(observed).distribution.entropy().sum(dim=1)
    torch.testing.assert_close(bonus, 0.3 * entropy)


def test_a_strong_penalty_holds_ppo_near_the_demonstrator() -> None:
    def moved(penalty: float) -> float:
        demonstrator = policy_of((16, 16), seed=4)
        configuration = TINY_PPO._replace(
            hidden=(16, 16), demonstrator_penalty=penalty, learning_rate=1e-2, steps=10_000
        )
        learner = Improving(easy_environments(16), configuration, 0, demonstrator)
        for _ in range(2):
            learner.advance(SILENT)
        observed = {name: torch.from_numpy(values) for name, values in observations(100).items()}
        return float(learner.policy.divergence(observed).mean().detach())

    assert moved(0.0) > 1e-4
    assert moved(100.0) < 0.2 * moved(0.0)


# Learning


def test_gcbc_learns_and_beats_its_start(flown: Episodes) -> None:
    cloning = Cloning(transitions_of(flown), None, WHERE, GCBC_SMALL._replace(batch_size=256), 0)
    loss, start = cloning.losses()["training"], mean_return(cloning.policy)
    for _ in range(15):
        cloning.advance(SILENT)
    assert cloning.losses()["training"] < loss - 0.3
    assert mean_return(cloning.policy) > 0.5 * start  # returns are negative


def test_gcbc_is_validated_on_goals_that_it_is_not_shown(small_set: Dataset, tmp_path: Path) -> None:
    shown: list[Any] = []

    class Spied(Cloning):
        def __init__(self, *arguments: Any) -> None:
            shown.extend(arguments[:2])
            super().__init__(*arguments)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("vvc_bench.baselines.recipes.Cloning", Spied)
        configuration = GCBC_SMALL._replace(batch_size=256, epochs=1)
        document = train_gcbc(Setting("normal", evaluations=1), tmp_path / "run", small_set, "small", configuration)
    training, validation = (set(map(tuple, part.goals.tolist())) for part in shown)
    assert training
    assert validation
    assert not training & validation
    assert document["plan"]["demonstrations"] == {"name": "small", "hash": small_set.hash}


def test_ppo_beats_its_start() -> None:
    configuration = PPO_SMALL._replace(environments=32, batch_size=1024, steps=60_000)
    learner = Improving(easy_environments(32), configuration, 0)
    start = mean_return(learner.policy)
    while learner.done < configuration.steps:
        learner.advance(SILENT)
    assert mean_return(learner.policy) > 0.8 * start


@pytest.mark.parametrize("hindsight", [False, True])
def test_sac_beats_its_start(hindsight: bool) -> None:
    short = {"step_limit": 60, "terminations": ("reach_target", "time_limit"), "reach_steps": 1}
    learner = SoftActorCritic(
        easy_environments(16, reward="sparse" if hindsight else "distance", **short),
        SAC_SMALL._replace(learning_starts=500, discount=0.9, hidden=(64, 64), batch_size=128, hindsight=hindsight),
        0,
    )
    start = mean_return(learner.policy, reward="sparse", **short)
    while learner.done < (4096 if hindsight else 3072):
        learner.advance(SILENT)
    assert mean_return(learner.policy, reward="sparse", **short) > start + 4.0  # steps, of some 48


def test_ppo_begins_as_the_demonstrator_and_warms_its_value_function_up() -> None:
    demonstrator = policy_of((16, 16), seed=3)
    configuration = TINY_PPO._replace(hidden=(16, 16), warm_up_steps=600)
    learner = Improving(easy_environments(16), configuration, 0, demonstrator)
    observed = observations(100)

    def acts() -> np.ndarray:
        return learner.policy.predict(observed, deterministic=True)[0]

    def critic() -> np.ndarray:
        return learner.policy.value_net.weight.detach().numpy().copy()

    begun, shown = critic(), demonstrator.predict(observed, deterministic=True)[0]
    np.testing.assert_array_equal(acts(), shown)
    learner.advance(SILENT)  # 512 steps
    learner.advance(SILENT)  # 1024, the last that began within the warm-up
    np.testing.assert_array_equal(acts(), shown)
    assert (critic() != begun).any()
    learner.advance(SILENT)
    assert (acts() != shown).any()


def test_exploration_begins_as_the_configuration_says() -> None:
    learner = Improving(
        easy_environments(16), TINY_PPO._replace(hidden=(16, 16), first_exploration=0.3), 0, policy_of()
    )
    np.testing.assert_allclose(learner.policy.log_std.exp().detach().numpy(), 0.3, rtol=1e-6)
    assert (policy_of().log_std == 0.0).all()


def test_scaled_rewards_leave_returns_and_flights_as_they_are() -> None:
    plain, scaled = easy_environments(4), UnitActions(easy_environments(4).venv, 0.5)
    for environments in (plain, scaled):
        environments.reset()
    generator, ended = np.random.default_rng(0), 0
    for _ in range(500):
        actions = generator.uniform(-1.0, 1.0, (4, 3)).astype(np.float32)
        (_, rewards, dones, infos), (_, halved, _, same) = plain.step(actions), scaled.step(actions)
        np.testing.assert_array_equal(halved, rewards * np.float32(0.5))
        for i in np.flatnonzero(dones):
            assert infos[i]["episode"]["r"] == same[i]["episode"]["r"]
            ended += 1
    assert ended > 0


def test_the_learning_rate_falls_to_nothing_over_the_configurations_steps() -> None:
    learner = Improving(easy_environments(16), TINY_PPO._replace(steps=2048, warm_up_steps=512), 0)
    rates = []
    for _ in range(5):
        learner.advance(SILENT)
        rates.append(learner.policy.optimizer.param_groups[0]["lr"])
    np.testing.assert_allclose(rates, TINY_PPO.learning_rate * np.array([1.0, 0.75, 0.5, 0.25, 0.0]), atol=1e-12)


def test_ppo_refuses_what_does_not_fit() -> None:
    with pytest.raises(ValueError, match="networks are others"):
        Improving(easy_environments(16), TINY_PPO, 0, policy_of((8, 8)))
    with pytest.raises(ValueError, match="is for 16 environments, got 4"):
        Improving(easy_environments(4), TINY_PPO, 0)


# Going on


def cloning_of(flown: Episodes) -> Callable[[], Any]:
    return lambda: Cloning(transitions_of(flown), None, WHERE, GCBC_SMALL._replace(batch_size=512), 3)


def improving(configuration: PpoConfiguration = TINY_PPO, curriculum: str | None = None) -> Any:
    return Improving(make_environments(Setting("normal"), 16, curriculum), configuration, 3)


def hindsight() -> Any:
    fields = {"reward": "sparse", "reach_steps": 1}
    return SoftActorCritic(easy_environments(4, **fields), TINY_SAC._replace(hindsight=True), 0)


LEARNERS: dict[str, Callable[[], Any]] = {
    "ppo": improving,
    "ppo, state-dependent exploration": lambda: improving(TINY_PPO._replace(state_dependent_exploration=True)),
    "ppo, mega": lambda: improving(curriculum="mega"),
    "ppo, intermediate": lambda: improving(curriculum="intermediate"),
    "sac-her": hindsight,
}


@pytest.mark.parametrize("name", ["gcbc", *LEARNERS])
def test_a_learner_that_was_stopped_goes_on_as_if_it_had_not_been(name: str, flown: Episodes, tmp_path: Path) -> None:
    make = LEARNERS.get(name) or cloning_of(flown)
    unbroken = make()
    for _ in range(3):
        unbroken.advance(SILENT)
    stopped = make()
    stopped.advance(SILENT)
    torch.save(stopped.state(), tmp_path / "kept.pt")
    stopped.advance(SILENT)  # what was done since is lost
    other = make()
    other.restore(torch.load(tmp_path / "kept.pt", weights_only=False))
    for _ in range(2):
        other.advance(SILENT)
    assert other.done == unbroken.done
    assert weights_sha256(other.policy.state_dict()) == weights_sha256(unbroken.policy.state_dict())
    assert weights_sha256(other.policy.state_dict()) != weights_sha256(make().policy.state_dict())


def test_networks_are_on_the_device_that_is_asked_for(monkeypatch: pytest.MonkeyPatch) -> None:
    """PyTorch refuses to reckon with tensors of two devices; ``meta``, which holds no values, every machine has."""
    monkeypatch.setattr(torch.distributions.Distribution, "_validate_args", False)  # it would look at values
    where = torch.device("meta")
    penalised = TINY_PPO._replace(demonstrator_penalty=0.1)
    learner = Improving(make_environments(Setting("normal"), 16), penalised, 0, policy_of(TINY_PPO.hidden), where)
    seen = {name: torch.from_numpy(each).to(where) for name, each in observations(8).items()}
    told = learner.policy.evaluate_actions(seen, torch.zeros((8, 3), device=where))
    assert [each.device for each in told] == [where] * 3
    for other in (SoftActorCritic(easy_environments(4), TINY_SAC, 0, where), learner):
        parameters, variables = (other.state()[part] for part in ("parameters", "variables"))
        held = [*parameters["policy"].values(), *variables.values()]
        assert {each.device for each in held} == {where}


def test_a_training_says_where_it_took_place(small_set: Dataset, tmp_path: Path) -> None:
    configuration = GCBC_SMALL._replace(epochs=1, batch_size=512)
    setting = Setting("normal", evaluations=1, device=find_device("auto"))
    document = train_gcbc(setting, tmp_path / "run", small_set, "small", configuration)
    assert torch.device(document["device"]).type == ("cuda" if torch.cuda.is_available() else "cpu")


TRAIN_SLOWLY = """
import sys, time
from pathlib import Path
from vvc_bench.baselines import gcbc, recipes
from vvc_bench.baselines.configurations import GCBC_SMALL
from vvc_bench.datasets.store import open_dataset
advance = gcbc.Cloning.advance
def slowly(self, logger):
    advance(self, logger)
    time.sleep(3.0)
gcbc.Cloning.advance = slowly
setting = recipes.Setting("normal", evaluations=1, between=0.0)
configuration = GCBC_SMALL._replace(epochs=6, batch_size=512)
recipes.train_gcbc(setting, Path(sys.argv[2]), open_dataset(sys.argv[1]), "small", configuration)
"""


def test_a_killed_training_ends_with_the_weights_of_an_unbroken_one(small_set: Dataset, tmp_path: Path) -> None:
    command = [sys.executable, "-c", TRAIN_SLOWLY, str(small_set.folder), str(tmp_path / "killed")]
    with subprocess.Popen(command) as process:
        deadline = time.monotonic() + 120
        while _done(tmp_path / "killed") < 2:
            assert time.monotonic() < deadline
            assert process.poll() is None
            time.sleep(0.02)
        os.kill(process.pid, signal.SIGKILL)
    (tmp_path / "killed" / ".last.1234abcd.unfinished.pt").write_bytes(b"half a checkpoint")
    assert not read_training(tmp_path / "killed")["finished"]
    setting, configuration = Setting("normal", evaluations=1), GCBC_SMALL._replace(epochs=6, batch_size=512)
    killed, unbroken = (
        train_gcbc(setting, tmp_path / folder, small_set, "small", configuration) for folder in ("killed", "unbroken")
    )
    assert killed["finished"]
    assert killed["done"] == 6
    for key in ("weights_sha256", "evaluations", "policies", "plan"):
        assert killed[key] == unbroken[key]
    assert not list((tmp_path / "killed").glob(".*"))


def _done(folder: Path) -> int:
    try:
        return int(read_training(folder).get("done", 0))
    except FileNotFoundError:
        return 0


def test_a_folder_is_of_one_plan(small_set: Dataset, tmp_path: Path) -> None:
    configuration = GCBC_SMALL._replace(epochs=1, batch_size=512)
    setting, place = Setting("normal", evaluations=1), tmp_path / "run"
    first = train_gcbc(setting, place, small_set, "small", configuration)
    written = (place / LAST).stat().st_mtime_ns
    assert train_gcbc(setting, place, small_set, "small", configuration) == first
    assert (place / LAST).stat().st_mtime_ns == written
    with pytest.raises(ValueError, match="holds a training with seed 0, not 1"):
        train_gcbc(Setting("normal", 1, 1), place, small_set, "small", configuration)
    (tmp_path / "other").mkdir()
    (tmp_path / "other" / "letters.txt").write_text("mine")
    with pytest.raises(FileExistsError, match="other things"):
        train_gcbc(setting, tmp_path / "other", small_set, "small", configuration)
    assert [path.name for path in (tmp_path / "other").iterdir()] == ["letters.txt"]
    with pytest.raises(ValueError, match="unknown protocol 'flycraft-validation-v0'"):
        train_gcbc(Setting("flycraft"), tmp_path / "new", small_set, "small", configuration)
    assert not (tmp_path / "new").exists()


# Curricula


def achieved(generator: np.random.Generator, count: int) -> np.ndarray:
    """Crowded at 180 m/s, one in fifty thinly spread over the box."""
    crowd = generator.normal((180.0, 0.0, 0.0), (3.0, 0.5, 1.0), (count, 3))
    spread = generator.uniform(EVERYWHERE.low, EVERYWHERE.high, (count, 3))
    return np.where((generator.random(count) < 0.02)[:, None], spread, crowd)


EVERYWHERE = UniformBox((150.0, -10.0, -30.0), (250.0, 10.0, 30.0))


def taught(name: str) -> Curriculum:
    curriculum = ACHIEVED[name](EVERYWHERE, 0, renewed=2000, fitted=1000, remembered=0.5)
    generator = np.random.default_rng(1)
    for _ in range(40):
        curriculum.observe(achieved(generator, 1000).astype(np.float32))
        curriculum.observe(np.tile(np.float32([400.0, 50.0, 100.0]), (100, 1)))  # outside the box
    return curriculum


def drawn(curriculum: Curriculum, count: int = 1000) -> np.ndarray:
    generator = np.random.default_rng(2)
    return np.array([curriculum.sample(generator) for _ in range(count)])


def in_crowd(goals: np.ndarray) -> float:
    return float((np.abs(goals[:, 0] - 180.0) < 15.0).mean())


def test_curricula_draw_from_the_box_at_first() -> None:
    for name in CURRICULA:
        goals = drawn(make_curriculum(name, EVERYWHERE, 0))
        assert 0.2 < in_crowd(goals) < 0.4


def test_rig_draws_what_was_achieved() -> None:
    assert in_crowd(drawn(taught("rig"))) > 0.9


def test_discern_draws_rare_and_frequent_alike() -> None:
    assert 0.02 < in_crowd(drawn(taught("discern"))) < 0.6


def test_mega_draws_what_was_achieved_least() -> None:
    curriculum = taught("mega")
    goals = drawn(curriculum)
    assert in_crowd(goals) < 0.6
    generator = np.random.default_rng(1)
    known = np.concatenate([achieved(generator, 1000) for _ in range(40)]).astype(np.float32)
    assert set(map(tuple, goals.astype(np.float32).tolist())) <= set(map(tuple, known.tolist()))


@pytest.mark.parametrize("name", ACHIEVED)
def test_curricula_keep_to_the_box_and_to_the_generator(name: str) -> None:
    goals = drawn(taught(name))
    assert (goals >= EVERYWHERE.low).all()
    assert (goals <= EVERYWHERE.high).all()
    np.testing.assert_array_equal(goals, drawn(taught(name)))


def concluded(reachable: Callable[[np.ndarray], np.ndarray], episodes: int = 40_000) -> Intermediate:
    """After episodes with goals from everywhere and beyond it."""
    curriculum = Intermediate(EVERYWHERE)
    generator = np.random.default_rng(3)
    for _ in range(episodes // 1000):
        goals = generator.uniform((140.0, -12.0, -35.0), (260.0, 12.0, 35.0), (1000, 3)).astype(np.float32)
        curriculum.conclude(goals, generator.random(1000) < reachable(goals))
    return curriculum


def test_intermediate_draws_goals_that_are_reached_sometimes() -> None:
    """Below 170 m/s never, above 230 m/s always, and more and more often between them."""
    curriculum = concluded(lambda goals: np.clip((goals[:, 0] - 170.0) / 60.0, 0.0, 1.0))
    by_speed = curriculum.shares().mean(axis=(1, 2))
    np.testing.assert_allclose(by_speed[:2], 0.0, atol=0.15)
    np.testing.assert_allclose(by_speed[-2:], 1.0, atol=0.15)
    assert (np.diff(by_speed) > -0.05).all()
    goals = drawn(curriculum)
    assert (goals >= EVERYWHERE.low).all()
    assert (goals <= EVERYWHERE.high).all()
    speeds = np.histogram(goals[:, 0], bins=[150.0, 170.0, 190.0, 210.0, 230.0, 250.0])[0]
    assert speeds[2] > 1.5 * max(speeds[0], speeds[4])
    assert speeds.min() > 0.05 * len(goals)


def test_intermediate_draws_evenly_what_has_one_chance_everywhere() -> None:
    goals = drawn(concluded(lambda goals: np.full(len(goals), 0.5)))
    assert 0.2 < in_crowd(goals) < 0.4


def test_intermediate_keeps_to_cells_that_hold_goals_asked_for() -> None:
    """Here two: one in a corner of the box, one elsewhere; cells are 10 m/s, 20/17° and 60/17° wide."""
    asked = np.array([[150.0, -10.0, -30.0], [222.0, 3.0, 1.0], [400.0, 0.0, 0.0]])
    curriculum = Intermediate(EVERYWHERE, among=asked)
    before = drawn(curriculum)
    generator = np.random.default_rng(4)
    for _ in range(5):
        curriculum.conclude(generator.uniform(EVERYWHERE.low, EVERYWHERE.high, (1000, 3)), np.ones(1000, dtype=bool))
    for goals in (before, drawn(curriculum)):
        distances = np.abs(goals[:, None] - asked[:2]) < np.array([10.0, 20.0 / 17.0, 60.0 / 17.0])
        near = distances.all(axis=2)
        assert near.any(axis=1).all()
        assert (near.mean(axis=0) > 0.4).all()
    with pytest.raises(ValueError, match="no goal to learn: none of 1 lies in"):
        Intermediate(EVERYWHERE, among=asked[2:])


def test_intermediate_forgets() -> None:
    curriculum = concluded(lambda goals: np.zeros(len(goals)))
    assert curriculum.shares().mean() < 0.2
    generator = np.random.default_rng(4)
    for _ in range(100):
        curriculum.conclude(generator.uniform(EVERYWHERE.low, EVERYWHERE.high, (1000, 3)), np.ones(1000, dtype=bool))
    assert curriculum.shares().mean() > 0.8


def test_a_curriculum_sees_where_a_learner_gets_to() -> None:
    learner = improving(curriculum="mega")
    curriculum = learner.algorithm.env.get_attr("goals", 0)[0]
    learner.advance(SILENT)
    assert curriculum._count > 0


def test_a_curriculum_sees_which_goals_a_learner_reaches() -> None:
    learner = improving(curriculum="intermediate")
    curriculum = learner.algorithm.env.get_attr("goals", 0)[0]
    ended = 0
    for _ in range(5):
        learner.advance(SILENT)
        ended += len(learner.algorithm.ep_info_buffer)
    assert 0 < curriculum._flown.sum() <= ended
    assert curriculum._reached.sum() <= curriculum._flown.sum()


# Configurations and the command


def test_configurations_by_name() -> None:
    assert CONFIGURATIONS["ppo"]["released"].steps == 200_000_000
    assert [each.demonstrator_penalty for each in STAGED["irpo"]["released"].improving] == [1e-3, 1e-1, 1e-1]
    shortened = with_amount(STAGED["gcbc-ppo"]["released"].improving[0], 1_000_000)
    assert (shortened.steps, shortened.warm_up_steps) == (1_000_000, 100_000)
    assert amount_of(shortened) == 1_100_000


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["gcbc"], "name a set with --demos"),
        (["ppo", "--demos", "pid-v0"], "--demos means nothing to ppo"),
        (["gcbc", "--demos", "pid-v0", "--steps", "9"], "--steps means nothing to gcbc"),
        (["sac", "--epochs", "9"], "--epochs means nothing to sac"),
        (["gcbc", "--demos", "pid-v0", "--curriculum", "mega"], "--curriculum means nothing to gcbc"),
        (["irpo", "--demos", "pid-v0", "--protocol", "hard-sets-validation-v0"], "--protocol means nothing to irpo"),
        (["ppo", "--seeds", "2"], "--seeds means nothing to ppo"),
        (["gcbc", "--demos", "pid-v0", "--processes", "2"], "--processes means nothing to gcbc"),
        (["sac", "--begin-with", "runs/x"], "--begin-with means nothing to sac"),
        (["irpo", "--demos", "pid-v0", "--lacking", "pid-v0"], "--lacking means nothing to irpo"),
        (["ppo", "--lacking", "pid-v0"], "--lacking goes with --curriculum intermediate"),
        (["ppo", "--begin-with", "runs/x"], "holds no training with a policy to begin with"),
        (["ppo", "--configuration", "best"], "unknown configuration 'best' of ppo; known are released, fast"),
        (["ppo", "--seed", "-1"], "--seed must not be negative"),
        (["ppo", "--device", "gpu"], "networks cannot be trained on 'gpu' here: "),
        (["ppo", "--device", "meta"], "networks cannot be trained on 'meta' here: "),
        (["ppo", "--device", "mps" if torch.cuda.is_available() else "cuda"], "choose cpu, or auto"),
        (["ppo", "--set", "band=1"], "unknown task field 'band'"),
        (["ppo", "--set", "direction_band_deg=-1"], "direction_band_deg must"),
        (["ppo", "--task", "flycraft"], "unknown protocol 'flycraft-validation-v0'"),
    ],
)
def test_the_command_refuses_on_one_line(
    arguments: list[str], message: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["train", *arguments, "--output", str(tmp_path / "run")]) == 2
    error = capsys.readouterr().err
    assert message in error
    assert error.count("\n") == 1
    assert not (tmp_path / "run").exists()


def test_the_command_trains_judges_and_leaves_a_policy(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    place = tmp_path / "run"
    arguments = ["train", "ppo", "--task", "normal", "--configuration", "small", "--steps", "2e4", "--evaluations", "1"]
    arguments += ["--set", "direction_band_deg=2"]
    assert main([*arguments, "--output", str(place), "--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert document == json.loads((place / TRAINING).read_text())
    assert document["protocol"] == "normal-validation-v0"
    assert document["plan"]["fields"] == {"direction_band_deg": 2.0}
    start, end = document["evaluations"]
    assert start["done"] == 0
    assert end["done"] == document["done"] >= 20_000
    assert end["return"]["mean"] > start["return"]["mean"]
    for name in (POLICY, BEST_POLICY):
        assert open_agent(str(place / name)).describe()["sha256"] == document["policies"][name]
    assert list((place / "logs").glob("events.*"))

    arguments += ["--begin-with", str(place), "--protocol", "normal-sets-validation-v0"]
    arguments += ["--curriculum", "intermediate", "--lacking", "pid-sample-v0"]
    arguments += ["--output", str(tmp_path / "further"), "--json"]
    assert main(arguments) == 0
    further = json.loads(capsys.readouterr().out)
    best = torch.load(place / "best.pt", weights_only=True)
    assert further["plan"]["demonstrator"] == {"sha256": weights_sha256(best)}
    assert further["protocol"] == "normal-sets-validation-v0"
    lacking = load_dataset("pid-sample-v0")
    assert further["plan"]["lacking"] == {"name": lacking.name, "hash": lacking.hash}


def test_what_a_set_lacks_alone_is_learned_and_judged(tmp_path: Path) -> None:
    """Of the grid's path angles in the box, −10° to 10° by 5°, the last; cells are 20/17° wide."""
    steep = SimpleNamespace(name="no-climbs", hash="0" * 64, is_seen=lambda goals: goals[:, 1] < 8.0)
    setting = Setting("normal", evaluations=1, lacking=cast(Dataset, steep))
    learned = make_environments(setting, 16, "intermediate").get_attr("goals", 0)[0]
    assert drawn(learned)[:, 1].min() >= 10.0 - 20.0 / 17.0
    document = train_ppo(setting, tmp_path / "run", "test", TINY_PPO, curriculum="intermediate")
    covered = learned.covers(named_protocol("normal-validation-v0").goals)
    assert 20 < covered.sum() < 100
    assert [each["success"]["episodes"] for each in document["evaluations"]] == [covered.sum()] * 2
    with pytest.raises(ValueError, match="with the curriculum intermediate, not mega"):
        make_environments(setting, 16, "mega")
    nothing = dataclasses.replace(
        setting, lacking=cast(Dataset, SimpleNamespace(is_seen=lambda goals: goals[:, 1] < 90))
    )
    with pytest.raises(ValueError, match="no goal to learn: none of 0"):
        make_environments(nothing, 16, "intermediate")


def test_irpo_adds_flights_of_its_policies_and_goes_on(tmp_path: Path) -> None:
    ppo = TINY_PPO._replace(demonstrator_penalty=1e-3, warm_up_steps=500, learning_rate=3e-4)
    configuration = StagedConfiguration(GCBC_SMALL._replace(epochs=4), (ppo, ppo), by_task=1, keeps_critic=True)
    variant = {"direction_band_deg": 1.0}
    dataset, setting = load_dataset("pid-sample-v0"), Setting("normal", evaluations=1, fields=variant)

    def run(setting: Setting, processes: int = 1) -> dict[str, Any]:
        more = {"seeds": (2,), "processes": processes, "curriculum": "intermediate"}
        return train_irpo(setting, tmp_path / "run", dataset, "test", configuration, **more)

    result = run(setting, processes=2)
    kept = {path: path.stat().st_mtime_ns for path in (tmp_path / "run").rglob("*") if path.name != SUMMARY}
    updated, image = (open_dataset(tmp_path / "run" / name) for name in ("1-set", "1-set-mirrored"))
    policies = [open_agent(str(tmp_path / "run" / f"1-seed{seed}" / "ppo" / BEST_POLICY)) for seed in (0, 1)]
    hashes = [f"sha256:{policy.describe()['sha256']}" for policy in policies]
    assert len(set(hashes)) == 2

    begun = fly_under(dataset.read(), LEARNED)
    assert 0 < len(begun) <= len(dataset)
    seeds = np.zeros(315, dtype=np.int64)
    flown = [fly_policy(LEARNED, SAMPLE_GRID.goals, policy.begin(seeds)).episodes for policy in policies]
    known = [dict(zip(map(tuple, each.goals.tolist()), each.lengths.tolist(), strict=True)) for each in (begun, *flown)]
    shortest = {goal: min(each.get(goal, 9999) for each in known) for goal in {goal for each in known for goal in each}}
    assert dict(zip(map(tuple, updated.goals.tolist()), updated.lengths.tolist(), strict=True)) == shortest
    shares = [len(updated.where(source=f"irpo1-seed0/{each}")) for each in hashes]
    assert all(0 < share < len(updated) for share in shares)
    assert updated.manifest["specification"]["recipe"]["policies"] == hashes
    reports = updated.manifest["metrics"]["updates"]
    assert [reports[each]["reached"] for each in hashes] == [len(each) for each in flown]
    assert len(begun) + sum(report["new_goals"] for report in reports.values()) == len(updated)
    assert updated.manifest["parents"] == {"pid-sample-v0": dataset.hash}
    assert updated.manifest["counts"]["goals_flown"] == image.manifest["counts"]["goals_flown"] == 315
    assert fly_again(updated.read()).divergences == ()
    assert len(image) >= len(updated)

    places = [f"{k}-seed{seed}/{stage}" for k in (1, 2) for seed in (0, 1) for stage in ("gcbc", "ppo")]
    plans = [read_training(tmp_path / "run" / place)["plan"] for place in places]
    assert [plan["seed"] for plan in plans] == [0, 0, 1, 1] * 2
    assert [plan["protocol"] for plan in plans] == [None] * 4 + ["normal-sets-validation-v0"] * 4
    assert named_protocol("normal-sets-validation-v0").scenario == LEARNED
    assert [plan["fields"] for plan in plans[1::2]] == [{}, {}, variant, variant]
    assert [plan["curriculum"] for plan in plans[1::2]] == ["intermediate"] * 4
    critics = [
        weights_sha256(torch.load(tmp_path / "run" / f"1-seed{seed}" / "ppo" / "best.pt", weights_only=True))
        for seed in (0, 1)
    ]
    assert [plan["demonstrator"].get("critic_sha256") for plan in plans[1::2]] == [None, None, *critics]
    first = {"name": dataset.name, "hash": dataset.hash}
    after = {"name": "irpo1-aug-seed0", "hash": image.hash}
    assert [plan["demonstrations"] for plan in plans[::2]] == [first, first, after, after]

    assert run(setting) == result
    assert kept == {path: path.stat().st_mtime_ns for path in (tmp_path / "run").rglob("*") if path.name != SUMMARY}
    with pytest.raises(ValueError, match="holds a training with"):
        run(Setting("normal", evaluations=2))
    with pytest.raises(ValueError, match="one for each of 2 iterations"):
        train_irpo(setting, tmp_path / "run", dataset, "test", configuration, seeds=(1, 2, 2))
    with pytest.raises(ValueError, match="at least one seed and one process, got"):
        run(setting, processes=0)


def test_a_killed_irpo_leaves_no_training_behind(tmp_path: Path) -> None:
    arguments = ["--demos", "pid-sample-v0", "--configuration", "small", "--task", "normal", "--epochs", "500"]
    command = [sys.executable, "-m", "vvc_bench", "train", "irpo", *arguments, "--seeds", "2", "--processes", "2"]
    with subprocess.Popen([*command, "--output", str(tmp_path / "run")]) as process:
        folders = [tmp_path / "run" / f"1-seed{seed}" / "gcbc" for seed in (0, 1)]
        deadline = time.monotonic() + 120
        while not all((folder / TRAINING).is_file() for folder in folders):
            assert process.poll() is None
            assert time.monotonic() < deadline
            time.sleep(0.1)
        os.kill(process.pid, signal.SIGKILL)
    for folder in folders:
        with locked(folder):  # which waits for as long as somebody trains there
            assert not read_training(folder)["finished"]


def test_gcbc_and_then_ppo_names_its_demonstrator(small_set: Dataset, tmp_path: Path) -> None:
    cloning = GCBC_SMALL._replace(epochs=2, batch_size=512)
    configuration = StagedConfiguration(cloning, (TINY_PPO._replace(hidden=(16, 16)),))
    documents = train_gcbc_ppo(Setting("normal", evaluations=1), tmp_path, small_set, "test", configuration)
    best = torch.load(tmp_path / "gcbc" / "best.pt", weights_only=True)
    assert documents["ppo"]["plan"]["demonstrator"] == {"sha256": weights_sha256(best)}
    assert documents["ppo"]["evaluations"][0]["success"] == documents["gcbc"]["best"]["success"]


def test_what_is_judged_is_the_scenario_that_is_trained() -> None:
    environments = make_environments(Setting("hard"), 4)
    assert environments.venv.task == Scenario(TASKS["hard"].task).task
    variant = make_environments(Setting("hard"), 4, direction_band_deg=1)
    assert variant.venv.task == make_task(TASKS["hard"].task, direction_band_deg=1)
