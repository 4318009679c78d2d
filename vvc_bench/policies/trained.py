"""Trained policies that come with the package, as ONNX files: those whose flights are in sets.

How each was trained is in ``results/trainings`` of the repository, and in docs/learning.md.
"""

from importlib.resources import as_file, files

from vvc_bench.policies.onnx import OnnxAgent, open_onnx

TRAINED = (
    "irpo1-seed0",
    *(f"irpo{k}-seed{seed}" for k in (2, 3) for seed in (0, 1)),
    *(f"learned{k}" for k in (2, 3, 4)),
    *(f"learned5-seed{seed}" for seed in (0, 1)),
)
"""Their names."""

_MODELS = "models"


def open_trained(name: str) -> OnnxAgent:
    """One of `TRAINED`.

    Raises:
        ValueError: for another name.
        ImportError: without onnxruntime; says what to install.
    """
    if name not in TRAINED:
        raise ValueError(f"unknown trained policy {name!r}; known are {', '.join(TRAINED)}")
    with as_file(files("vvc_bench.policies") / _MODELS / f"{name}.onnx") as path:
        return open_onnx(path)


def find_trained(sha256: str) -> OnnxAgent:
    """The one with this hash.

    Raises:
        ValueError: if there is none: the package is another version than the name that the hash comes from.
        ImportError: without onnxruntime; says what to install.
    """
    for name in TRAINED:
        agent = open_trained(name)
        if agent.sha256 == sha256:
            return agent
    raise ValueError(f"no policy of the package has the SHA-256 {sha256}: is the installation whole?")
