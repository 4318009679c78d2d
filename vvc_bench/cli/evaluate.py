"""``vvc-bench evaluate``: fly policies to every goal of a protocol, and keep the results."""

import argparse
import json
from collections import Counter
from pathlib import Path
from typing import Any

from vvc_bench.datasets.best import CONTESTS, best_known
from vvc_bench.datasets.progress import progress_line
from vvc_bench.datasets.sources import load_dataset
from vvc_bench.evaluation import PROTOCOLS, Evaluation, evaluate, named_protocol
from vvc_bench.policies import Agent, open_agent
from vvc_bench.policies.built_in import BUILT_IN
from vvc_bench.policies.trained import TRAINED


def add_options(parser: argparse.ArgumentParser) -> None:
    """Say what can be chosen."""
    parser.formatter_class = argparse.RawDescriptionHelpFormatter
    width = max(map(len, PROTOCOLS))
    parser.epilog = "protocols:\n" + "\n".join(
        f"  {name:<{width}}  {protocol.summary}" for name, protocol in PROTOCOLS.items()
    )
    parser.add_argument(
        "--policy",
        nargs="+",
        required=True,
        metavar="POLICY",
        help=f"{', '.join((*BUILT_IN, *TRAINED))}, or policy.onnx; with --trust also model.zip, model.pt or "
        "module:factory",
    )
    parser.add_argument("--protocol", required=True, metavar="NAME", help="what to fly, see below")
    parser.add_argument(
        "--seeds", nargs="+", type=int, default=[0], metavar="SEED", help="of gusts, noise and policies (default: 0)"
    )
    parser.add_argument(
        "--output",
        type=Path,
        required=True,
        metavar="FOLDER",
        help="where; with several policies a folder in it for each",
    )
    parser.add_argument("--threads", type=int, help="at most so many (default: all cores); the results are the same")
    parser.add_argument("--batch-size", type=int, help="aircraft in the air at once, at most; the results are the same")
    parser.add_argument(
        "--training-set", metavar="SET", help="tell goals that occur in a demonstration set from others"
    )
    parser.add_argument("--trust", action="store_true", help="open policies that run code which comes with them")
    parser.add_argument("--json", action="store_true", help="print one JSON document")


def run(options: argparse.Namespace) -> int:
    """Do it.

    Returns:
        0.

    Raises:
        ValueError: for an unknown name, an impossible choice, or a policy that answers with anything but actions.
        ImportError: if a policy takes an extra that is not installed.
        OSError: if a policy cannot be read, or a folder not written.
    """
    protocol = named_protocol(options.protocol)
    settings = protocol.scenario.settings
    agents = [open_agent(policy, settings=settings, trust=options.trust) for policy in options.policy]
    folders = _folders(options.output, agents)
    training_set = None if options.training_set is None else load_dataset(options.training_set)
    best = best_known(protocol.name).lengths if protocol.name in CONTESTS else None
    summaries = []
    for agent, folder in zip(agents, folders, strict=True):
        with progress_line(f"{agent.name} on {protocol.name}", "flights") as show:
            evaluation = evaluate(
                agent,
                protocol,
                seeds=options.seeds,
                threads=options.threads,
                batch_size=options.batch_size,
                training_set=training_set,
                best=best,
                progress=show,
            )
        evaluation.write(folder)
        summaries.append({"folder": str(folder), **evaluation.summary})
        if not options.json:
            print("\n".join(_lines(agent.name, folder, evaluation)), flush=True)
    if options.json:
        print(json.dumps(summaries[0] if len(summaries) == 1 else summaries, indent=2))
    return 0


def _folders(output: Path, agents: list[Agent]) -> list[Path]:
    """The folder itself for one policy, one in it for each of several."""
    if len(agents) == 1:
        return [output]
    name, times = Counter(agent.name for agent in agents).most_common(1)[0]
    if times > 1:
        raise ValueError(
            f"{times} policies are called {name}; evaluate them one by one, each with an --output of its own"
        )
    return [output / agent.name.replace(":", ".") for agent in agents]


def _lines(name: str, folder: Path, evaluation: Evaluation) -> list[str]:
    summary, timing = evaluation.summary, evaluation.timing
    success, latency = summary["success"], timing["latency"]
    lines = [
        f"{name} on {summary['protocol']['name']}: {_share(success)}",
        f"  steps to goal {_spread(summary['length_steps'], 1)}, return {_spread(summary['return'], 1)}",
        f"  at the end: speed {_spread(summary['speed_error_mps'], 2)} m/s, path angle "
        f"{_spread(summary['path_angle_error_deg'], 2)}°, azimuth {_spread(summary['azimuth_error_deg'], 2)}°",
        "  ended by " + ", ".join(f"{event} {count:,}" for event, count in summary["terminations"].items()),
    ]
    if summary["time_ratio"]["mean"] is not None:
        lines.append(f"  length over that of the shortest known flight {_spread(summary['time_ratio'], 2)}")
    if "seen" in summary:
        lines.append(f"  goals seen in training: {_share(summary['seen'])}; others: {_share(summary['unseen'])}")
    return [
        *lines,
        f"  answers in {1e3 * latency['median_s']:.3g} ms (99 %: {1e3 * latency['p99_s']:.3g} ms) of "
        f"{1e3 * latency['budget_s']:.0f} ms; {timing['steps_per_s']:,.0f} steps/s, {timing['wall_s']:.1f} s",
        f"  {folder}",
    ]


def _share(success: dict[str, Any]) -> str:
    if not success["episodes"]:
        return "none"
    rate, low, high = (100.0 * success[key] for key in ("rate", "low", "high"))
    return f"{rate:.1f} % ({success['count']:,} of {success['episodes']:,}; 95 %: {low:.1f} to {high:.1f})"


def _spread(spread: dict[str, float | None], digits: int) -> str:
    if spread["mean"] is None:
        return "–"
    return f"{spread['mean']:.{digits}f} ± {spread['std']:.{digits}f}"
