"""``vvc-bench train``: train a baseline, or go on with a training that was interrupted."""

import argparse
import json
from pathlib import Path
from typing import Any

from vvc_bench.baselines.configurations import (
    CONFIGURATIONS,
    CURRICULA,
    INTERMEDIATE,
    STAGED,
    StagedConfiguration,
    with_amount,
)
from vvc_bench.datasets.progress import progress_line
from vvc_bench.datasets.sources import load_dataset
from vvc_bench.evaluation.protocols import PROTOCOLS
from vvc_bench.policies.agent import import_extra
from vvc_bench.tasks import TASKS, make_task

ALGORITHMS = (*CONFIGURATIONS, *STAGED)
_CLONING = ("gcbc", *STAGED)
_EXTRA = ("torch", "stable_baselines3", "imitation", "onnx", "onnxruntime")


def add_options(parser: argparse.ArgumentParser) -> None:
    """Say what can be chosen."""
    parser.add_argument("algorithm", choices=ALGORITHMS, help="what learns")
    parser.add_argument("--output", type=Path, required=True, metavar="FOLDER", help="a new one, or one to go on in")
    parser.add_argument("--task", choices=list(TASKS), default="hard", help="(default: %(default)s)")
    parser.add_argument("--demos", metavar="SET", help=f"a name, as pid-v0, or a folder; for {', '.join(_CLONING)}")
    parser.add_argument(
        "--begin-with",
        type=Path,
        metavar="FOLDER",
        help="a training whose best policy PPO improves on, as runs/irpo/1-seed0/ppo",
    )
    parser.add_argument("--configuration", default="released", metavar="NAME", help=_configurations())
    parser.add_argument("--seed", type=int, default=0, help="of all that is drawn (default: %(default)s)")
    parser.add_argument(
        "--seeds",
        type=_counts,
        default=[1],
        help="policies of each iteration of irpo: a number, or one for each, as 1,2,2 (default: 1)",
    )
    parser.add_argument(
        "--processes", type=count, default=1, help="trainings of irpo side by side, with --threads each (default: 1)"
    )
    parser.add_argument("--steps", type=count, help="steps of PPO or SAC, in place of the configuration's")
    parser.add_argument("--epochs", type=count, help="epochs of GCBC, in place of the configuration's")
    parser.add_argument(
        "--curriculum",
        choices=CURRICULA,
        help="where PPO and SAC take their goals from, in place of evenly from the task's box",
    )
    parser.add_argument(
        "--lacking",
        metavar="SET",
        help=f"learn by PPO or SAC only near goals that a set lacks; with --curriculum {INTERMEDIATE}",
    )
    parser.add_argument(
        "--evaluations",
        type=count,
        default=10,
        help="on the task's validation goals, on the way (default: %(default)s)",
    )
    parser.add_argument(
        "--protocol",
        type=_validation,
        metavar="NAME",
        help="validation goals of another protocol than the task's, as hard-sets-validation-v0",
    )
    parser.add_argument(
        "--set",
        type=_field,
        action="append",
        default=[],
        metavar="FIELD=VALUE",
        help="learn by PPO or SAC on a variant of the task, as --set direction_band_deg=1; may be given several times",
    )
    parser.add_argument("--threads", type=count, default=1, help="at most so many (default: %(default)s)")
    parser.add_argument(
        "--device",
        default="cpu",
        help="where networks are trained, as PyTorch names it: cpu, cuda, cuda:1, mps; auto takes CUDA where it is "
        "(default: %(default)s)",
    )
    parser.add_argument("--json", action="store_true", help="print one JSON document")


def run(options: argparse.Namespace) -> int:
    """Train.

    Raises:
        ValueError: for options that do not go together, or a folder with another training.
        ImportError: without the extra ``train``.
        OSError: if the folder cannot be written, or the set cannot be had.
    """
    _check(options)
    require_extra()
    document = _train(options)
    print(json.dumps(document, indent=2) if options.json else _summary(document))
    return 0


def require_extra() -> None:
    """Say what to install where a training cannot run.

    Raises:
        ImportError: without the extra ``train``.
    """
    for module in _EXTRA:
        import_extra(module, "train")


def _train(options: argparse.Namespace) -> dict[str, Any]:
    from vvc_bench.baselines import irpo, recipes
    from vvc_bench.baselines.devices import find_device

    setting = recipes.Setting(
        options.task,
        options.seed,
        options.evaluations,
        options.threads,
        progress=progress_line,
        fields=dict(options.set),
        protocol=options.protocol,
        lacking=load_dataset(options.lacking) if options.lacking else None,
        device=find_device(options.device),
    )
    where, name, configuration = options.output, options.configuration, _configuration(options)
    match options.algorithm:
        case "ppo":
            return recipes.train_ppo(
                setting, where, name, configuration, cloned=options.begin_with, curriculum=options.curriculum
            )
        case "sac" | "sac-her":
            return recipes.train_sac(setting, where, name, configuration, curriculum=options.curriculum)
    dataset = load_dataset(options.demos)
    match options.algorithm:
        case "gcbc":
            return recipes.train_gcbc(setting, where, dataset, name, configuration)
        case "gcbc-ppo":
            return recipes.train_gcbc_ppo(setting, where, dataset, name, configuration, curriculum=options.curriculum)
    return irpo.train_irpo(
        setting,
        where,
        dataset,
        name,
        configuration,
        seeds=options.seeds,
        processes=options.processes,
        curriculum=options.curriculum,
    )


def _configuration(options: argparse.Namespace) -> Any:
    known: Any = STAGED.get(options.algorithm) or CONFIGURATIONS[options.algorithm]
    if options.configuration not in known:
        raise ValueError(
            f"unknown configuration {options.configuration!r} of {options.algorithm}; known are {', '.join(known)}"
        )
    chosen = known[options.configuration]
    if not isinstance(chosen, StagedConfiguration):
        amount = options.epochs or options.steps
        return with_amount(chosen, amount) if amount else chosen
    if options.epochs:
        chosen = chosen._replace(cloning=with_amount(chosen.cloning, options.epochs))
    if options.steps:
        chosen = chosen._replace(improving=tuple(with_amount(each, options.steps) for each in chosen.improving))
    return chosen


def _check(options: argparse.Namespace) -> None:
    """Refuse what does not go together, before anything is made."""
    clones = options.algorithm in _CLONING
    if clones and not options.demos:
        raise ValueError(f"{options.algorithm} clones demonstrations: name a set with --demos, as --demos pid-v0")
    wrong = {
        "--demos": not clones and options.demos,
        "--epochs": not clones and options.epochs,
        "--steps": options.algorithm == "gcbc" and options.steps,
        "--curriculum": options.algorithm == "gcbc" and options.curriculum,
        "--set": options.algorithm == "gcbc" and options.set,
        "--begin-with": options.algorithm != "ppo" and options.begin_with,
        "--protocol": options.algorithm == "irpo" and options.protocol,
        "--lacking": options.algorithm in ("gcbc", "irpo") and options.lacking,
        "--seeds": options.algorithm != "irpo" and options.seeds != [1],
        "--processes": options.algorithm != "irpo" and options.processes > 1,
    }
    for option, given in wrong.items():
        if given:
            raise ValueError(f"{option} means nothing to {options.algorithm}; leave it out")
    if options.lacking and options.curriculum != INTERMEDIATE:
        raise ValueError(f"--lacking goes with --curriculum {INTERMEDIATE}")
    if options.seed < 0:
        raise ValueError(f"--seed must not be negative, got {options.seed}")
    make_task(TASKS[options.task].task, **dict(options.set))


def count(text: str) -> int:
    """A whole number from 1; 1e6 will do."""
    try:
        value = float(text)
    except ValueError:
        value = 0.0
    if not (1 <= value < 1e15 and value == int(value)):
        raise argparse.ArgumentTypeError(f"must be a whole number from 1, got {text!r}")
    return int(value)


def _counts(text: str) -> list[int]:
    return [count(part) for part in text.split(",")]


def _validation(text: str) -> str:
    """The name of a protocol whose goals no result is reported on, flown by guidance commands."""
    known = [name for name in PROTOCOLS if "validation" in name and "end-to-end" not in name]
    if text not in known:
        raise argparse.ArgumentTypeError(f"must be one of {', '.join(known)}, got {text!r}")
    return text


def _field(text: str) -> tuple[str, float | str]:
    """A field of the task by column name, and its value: a number, or a name as ``sparse``."""
    name, equals, value = text.partition("=")
    if not (name and equals and value):
        raise argparse.ArgumentTypeError(f"must be FIELD=VALUE, as direction_band_deg=1, got {text!r}")
    try:
        return name, float(value)
    except ValueError:
        return name, value


def _configurations() -> str:
    listed = "; ".join(f"{algorithm}: {', '.join(named)}" for algorithm, named in {**CONFIGURATIONS, **STAGED}.items())
    return f"(default: %(default)s) {listed}"


def _summary(document: dict[str, Any]) -> str:
    """A line for each training, and each set."""
    if "iterations" in document:
        lines = []
        for k, iteration in enumerate(document["iterations"], start=1):
            trained = iteration["trained"].items()
            lines.append(f"iteration {k}")
            lines += [_line(f"{each}/{name}", stage) for each, stages in trained for name, stage in stages.items()]
            lines += [
                f"  {part['name']:<20}{part['episodes']} flights" for part in map(iteration.get, ("set", "mirrored"))
            ]
        return "\n".join(lines)
    trainings = document if "plan" not in document else {document["plan"]["algorithm"]: document}
    return "\n".join(_line(name, training) for name, training in trainings.items())


def _line(name: str, training: dict[str, Any]) -> str:
    success = training["best"]["success"]
    interval = f"{success['low']:.1%} to {success['high']:.1%}"
    return f"  {name:<20}best {success['rate']:.1%} of validation goals ({interval}), {training['wall_s']:.0f} s"
