"""Find the policy that somebody names."""

from pathlib import Path

from vvc_bench import sim
from vvc_bench.policies.agent import Agent
from vvc_bench.policies.built_in import BUILT_IN, LAWS, RANDOM, LawAgent, RandomAgent
from vvc_bench.policies.onnx import open_onnx
from vvc_bench.policies.trained import TRAINED, open_trained
from vvc_bench.policies.trusted import open_python, open_stable_baselines, open_torchscript

_DEFAULT_SETTINGS = sim.Settings()

_TRUSTED = {".zip": open_stable_baselines, ".pt": open_torchscript}


def open_agent(policy: str, *, settings: sim.Settings = _DEFAULT_SETTINGS, trust: bool = False) -> Agent:
    """Open a policy.

    Args:
        policy: one of `vvc_bench.policies.built_in.BUILT_IN` or `vvc_bench.policies.trained.TRAINED`; the path of an
            ONNX file (``policy.onnx``), of a Stable-Baselines3 model (``model.zip``) or of a TorchScript module
            (``model.pt``); or ``"module:factory"``, a function without arguments that returns an `Agent` or a function
            from observations to actions.
        settings: how it will fly, which built-in policies need to know.
        trust: open those that can run any code: all but built-in ones and ONNX.

    Raises:
        ValueError: for a policy that is none, that cannot fly so, or that is not trusted.
        FileNotFoundError: for a file that is not there.
        ImportError: if it takes an extra that is not installed; says which.
    """
    ending = Path(policy).suffix.lower()
    if policy in BUILT_IN:
        return _built_in(policy, settings)
    if policy in TRAINED:
        return open_trained(policy)
    if ending == ".onnx":
        return open_onnx(Path(policy))
    if ending not in _TRUSTED and ":" not in policy:
        raise ValueError(
            f"unknown policy {policy!r}: give one of {', '.join((*BUILT_IN, *TRAINED))}, the path of a file that ends "
            f"with .onnx, {' or '.join(_TRUSTED)}, or module:factory"
        )
    if not trust:
        raise ValueError(
            f"opening {policy!r} runs code that comes with it: add --trust (trust=True) if you trust its author, "
            "or convert it to ONNX"
        )
    return _TRUSTED[ending](Path(policy)) if ending in _TRUSTED else open_python(policy)


def _built_in(name: str, settings: sim.Settings) -> Agent:
    if name == RANDOM:
        return RandomAgent(settings)
    if settings.control_mode != "guidance":
        raise ValueError(f"{name} commands roll rate and load factor; it cannot fly {settings.control_mode!r}")
    return LawAgent(name, LAWS[name])
