"""Make an entry: evaluate a policy as `verify` will, and write down what it did."""

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import pandas as pd

from vvc_bench.datasets.local import datasets_folder
from vvc_bench.datasets.store import open_dataset
from vvc_bench.evaluation import named_protocol
from vvc_bench.leaderboard import sandbox
from vvc_bench.leaderboard.confinement import Limits
from vvc_bench.leaderboard.entries import Entry, add_entry, require_free
from vvc_bench.leaderboard.submission import (
    CLAIMED,
    POLICY,
    TIME_FORMAT,
    BuiltInPolicy,
    Erratum,
    OnnxPolicy,
    Submission,
    TrainingData,
    parse_submission,
    sha256,
)
from vvc_bench.leaderboard.verify import (
    check_erratum,
    duplicate,
    readable_entries,
    require_packages,
    this_platform,
)
from vvc_bench.policies.built_in import BUILT_IN
from vvc_bench.policies.onnx import LARGEST_FILE

_UNKNOWN = sha256(b"")


@dataclass(frozen=True)
class About:
    """What an author says of an entry; see `Submission`."""

    author: str
    method: str
    entry: str | None = None
    training_data: tuple[TrainingData, ...] = ()
    budget: str | None = None
    code: str | None = None
    supersedes: Erratum | None = None


def submit(
    root: Path,
    policy: str,
    protocol: str,
    about: About,
    *,
    seeds: Sequence[int] = (0,),
    threads: int | None = None,
    limits: Limits = Limits(),  # noqa: B008  (immutable)
    progress: Callable[[int, int], object] = lambda _done, _total: None,
) -> Path:
    """Evaluate a policy in a confined process, and write an entry with what it did.

    Args:
        root: folder of all entries.
        policy: path of an ONNX model, or one of `BUILT_IN`.
        protocol: what to evaluate it by.
        about: what is to be said; the entry is called as the policy unless it says otherwise.
        seeds: of the evaluation.
        threads: at most so many.
        limits: what the confined process gets.
        progress: told how many flights are done, and of how many.

    Returns:
        The entry's folder.

    Raises:
        ValueError: for what `verify` would refuse; nothing is written then.
        FileExistsError: if there is an entry of that name.
        ImportError: without onnx or onnxruntime; says what to install.
        OSError: if it cannot be written.
    """
    model = None if policy in BUILT_IN else _read_model(Path(policy))
    chosen = named_protocol(protocol)
    draft = _draft(policy, model, chosen.name, chosen.hash, about, seeds)
    require_free(root / draft.protocol / draft.entry)
    others = readable_entries(root) if root.is_dir() else []
    check_erratum(draft, others)
    _refuse_duplicate(draft, others)
    require_packages()
    flown = sandbox.fly(
        chosen.name, policy if model is None else model, seeds, threads=threads, limits=limits, progress=progress
    )
    files = dict(flown.files)
    submission = replace(
        draft,
        files={name: sha256(content) for name, content in files.items()},
    )
    _refuse_duplicate(submission, others, flown.evaluation.episodes)
    return add_entry(root, submission, files | ({} if model is None else {POLICY: model}))


def training_data(text: str) -> TrainingData:
    """A set by name, ``NAME`` or ``NAME=SHA256``; the hash of a set on this machine is looked up.

    Raises:
        ValueError: if the set here is damaged.
    """
    name, _, given = text.partition("=")
    here = datasets_folder() / name
    if given or Path(name).name != name or not here.is_dir():
        return TrainingData(name, given or None)
    return TrainingData(name, open_dataset(here).hash)


def _read_model(path: Path) -> bytes:
    if path.suffix != ".onnx":
        raise ValueError(
            f"an entry's policy is an ONNX model (….onnx) or one of {', '.join(BUILT_IN)}, got {str(path)!r}; "
            "docs/policies.md tells how others are converted"
        )
    if not path.is_file():
        raise ValueError(f"there is no file {path}")
    if path.stat().st_size > LARGEST_FILE:
        raise ValueError(f"{path} has {path.stat().st_size} bytes; at most {LARGEST_FILE} are taken")
    return path.read_bytes()


def _draft(
    policy: str, model: bytes | None, protocol: str, protocol_hash: str, about: About, seeds: Sequence[int]
) -> Submission:
    """The submission before anything was flown, checked as it will be read."""
    draft = Submission(
        entry=about.entry if about.entry is not None else Path(policy).stem,
        protocol=protocol,
        protocol_sha256=protocol_hash,
        author=about.author,
        method=about.method,
        training_data=about.training_data,
        budget=about.budget,
        code=about.code,
        policy=BuiltInPolicy(policy) if model is None else OnnxPolicy(sha256(model), len(model)),
        seeds=tuple(seeds),
        files=dict.fromkeys(CLAIMED, _UNKNOWN),
        submitted=time.strftime(TIME_FORMAT, time.gmtime()),
        supersedes=about.supersedes,
        platform=this_platform(),
    )
    return parse_submission(draft.to_bytes(), Path("submission"))


def _refuse_duplicate(submission: Submission, others: Sequence[Entry], episodes: pd.DataFrame | None = None) -> None:
    copied = duplicate(submission, others, episodes)
    if copied:
        raise ValueError(copied)
