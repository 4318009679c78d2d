"""Sample flights of what was evaluated: the policy is opened and flown again, as in the evaluation."""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import numpy as np

from vvc_bench.evaluation.evaluate import Evaluation
from vvc_bench.evaluation.flights import chunks, fly_chunk
from vvc_bench.evaluation.methods import Method, protocol_hash, protocol_name
from vvc_bench.evaluation.protocols import Protocol, named_protocol
from vvc_bench.policies import Agent, open_agent
from vvc_bench.policies.agent import file_sha256
from vvc_bench.rollout import Episodes

SAMPLES = 40
_SEED = 0
"""Of which flights are chosen."""


def flown_protocols(methods: Sequence[Method]) -> dict[str, Protocol]:
    """The protocols of some evaluations, by name.

    Raises:
        ValueError: for a protocol that is unknown here, or was another one when it was flown.
    """
    found: dict[str, Protocol] = {}
    for evaluation in (evaluation for method in methods for evaluation in method.evaluations):
        protocol = named_protocol(protocol_name(evaluation))
        if protocol.hash != protocol_hash(evaluation):
            raise ValueError(
                f"{protocol.name} was another protocol when it was flown ({protocol_hash(evaluation)[:12]}, not "
                f"{protocol.hash[:12]}): evaluate {evaluation.summary['policy']['name']} again"
            )
        found[protocol.name] = protocol
    return found


def sample_flights(
    methods: Sequence[Method],
    protocols: Mapping[str, Protocol],
    policies: Sequence[Path] = (),
    progress: Callable[[int, int], object] = lambda _done, _total: None,
) -> dict[tuple[str, str], Episodes]:
    """Some flights of each method on each protocol, flown again by the first of its policies that is at hand.

    Args:
        methods: what was evaluated.
        protocols: by name.
        policies: ONNX files, of which those are used whose checksums the evaluations name; others have no effect.
        progress: told how many methods are done, and of how many.

    Returns:
        Name of the protocol and label of the method → flights. Left out are methods without a policy at hand: one that
        is neither built in nor among the files, or may run code of its own.

    Raises:
        FileNotFoundError: for a file that is not there.
        ValueError: for a file that is no policy.
        ImportError: for an ONNX file without onnxruntime; says what to install.
    """
    files = {file_sha256(path): path for path in policies}
    flights: dict[tuple[str, str], Episodes] = {}
    for k, method in enumerate(methods):
        progress(k, len(methods))
        for evaluation in method.evaluations:
            protocol = protocols[protocol_name(evaluation)]
            key = (protocol.name, method.label)
            agent = None if key in flights else _agent(evaluation, protocol, files)
            if agent is not None:
                flights[key] = _fly(agent, protocol, int(evaluation.summary["seeds"][0]))
    progress(len(methods), len(methods))
    return flights


def _agent(evaluation: Evaluation, protocol: Protocol, files: Mapping[str, Path]) -> Agent | None:
    policy = evaluation.summary["policy"]
    settings = protocol.scenario.settings
    if policy["kind"] == "built-in":
        return open_agent(policy["name"], settings=settings)
    if policy["kind"] == "onnx" and policy["sha256"] in files:
        return open_agent(str(files[policy["sha256"]]), settings=settings)
    return None


def _fly(agent: Agent, protocol: Protocol, seed: int) -> Episodes:
    """Flights from the first chunk, which is flown whole: what a policy answers may depend on its company in bits."""
    episodes = fly_chunk(agent, next(chunks(protocol, seed))).episodes
    chosen = np.random.default_rng(_SEED).permutation(len(episodes))[:SAMPLES]
    return episodes.select(np.sort(chosen))
