"""Evaluate a policy: the module that runs confined, with ``request.json`` and the policy in its working folder.

It prints a line for what it may do, lines of progress, and last what became of it; it writes ``evaluation/``, and
``held-out/`` where a seed was announced.
"""

import json
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

REQUEST, EVALUATION, HELD_OUT = "request.json", "evaluation", "held-out"


def say(**what: object) -> None:
    """Print one line that the parent reads."""
    sys.stdout.write(json.dumps(what) + "\n")
    sys.stdout.flush()


def answer(work: Callable[[], None]) -> None:
    """Do some work, and say how it went."""
    say(confined=json.loads(sys.argv[1]))
    try:
        work()
    except Exception as error:  # whatever a policy brings about is an answer
        say(refused=" ".join(f"{_kind(error)}{error}".split())[:1000])
    else:
        say(done=True)


def _kind(error: Exception) -> str:
    """What to call an error that was not raised to be read."""
    return "" if isinstance(error, ValueError) else f"{type(error).__name__}: "


def _evaluate() -> None:
    from vvc_bench.evaluation import evaluate, held_out, named_protocol
    from vvc_bench.leaderboard.model import check_model
    from vvc_bench.leaderboard.submission import POLICY
    from vvc_bench.policies import open_agent

    request: dict[str, Any] = json.loads(Path(REQUEST).read_text(encoding="utf-8"))
    if request["policy"] == POLICY:
        check_model(Path(POLICY).read_bytes())
    protocol = named_protocol(request["protocol"])
    agent = open_agent(request["policy"], settings=protocol.scenario.settings)
    protocols = {EVALUATION: protocol}
    if request["held_out"] is not None:
        protocols[HELD_OUT] = held_out(protocol, *request["held_out"])
    for folder, flown in protocols.items():
        flights = evaluate(
            agent,
            flown,
            seeds=request["seeds"],
            threads=request["threads"],
            progress=lambda done, total: say(progress=[done, total]),
        )
        flights.write(Path(folder))


if __name__ == "__main__":
    answer(_evaluate)
