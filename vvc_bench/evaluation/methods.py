"""What is compared and reported: evaluations by label, those of one label being runs of one method."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

from vvc_bench.evaluation.evaluate import Evaluation, read_evaluation


@dataclass(frozen=True)
class Method:
    """What stands on one line of a table: a policy, or several from runs of one method."""

    label: str
    evaluations: tuple[Evaluation, ...]


def protocol_name(evaluation: Evaluation) -> str:
    """Name of the protocol that was flown."""
    return str(evaluation.summary["protocol"]["name"])


def protocol_hash(evaluation: Evaluation) -> str:
    """Hash of the protocol that was flown."""
    return str(evaluation.summary["protocol"]["hash"])


def read_methods(places: Sequence[str]) -> tuple[Method, ...]:
    """Read evaluations, each from ``FOLDER`` or ``LABEL=FOLDER``.

    Folders with the same label are runs of one method. Without a label a folder has its own name, which must then be
    the only one on its protocol.

    Raises:
        ValueError: for a folder that holds no evaluation, or labels that say too little.
        OSError: for a folder that cannot be read.
    """
    labelled, own_names = [], set()
    for place in places:
        label, folder = _split(place)
        evaluation = read_evaluation(folder)
        name = label or folder.resolve().name
        key = (name, protocol_hash(evaluation))
        if not label and key in own_names:
            raise ValueError(
                f"two folders called {name} hold evaluations on {protocol_name(evaluation)}; name them, as in "
                f"first={folder}, with the same label if they are runs of one method"
            )
        own_names.add(key)
        labelled.append((name, evaluation))
    return gather(labelled)


def _split(place: str) -> tuple[str, Path]:
    """Label, if there is one, and folder; a folder may have an equals sign in its name."""
    label, equals, folder = place.partition("=")
    return (label, Path(folder)) if equals and label and not Path(place).exists() else ("", Path(place))


def gather(labelled: Iterable[tuple[str, Evaluation]]) -> tuple[Method, ...]:
    """Evaluations by label, in order of appearance.

    Raises:
        ValueError: for the same policy twice under one label on the same protocol.
    """
    methods: dict[str, list[Evaluation]] = {}
    for label, evaluation in labelled:
        methods.setdefault(label, []).append(evaluation)
    for label, evaluations in methods.items():
        _check_distinct(label, evaluations)
    return tuple(Method(label, tuple(evaluations)) for label, evaluations in methods.items())


def _check_distinct(label: str, evaluations: Sequence[Evaluation]) -> None:
    seen = set()
    for evaluation in evaluations:
        policy = evaluation.summary["policy"]
        key = (protocol_hash(evaluation), policy["kind"], policy.get("sha256") or policy["name"])
        if key in seen:
            raise ValueError(
                f"{label} holds the policy {policy['name']} twice on {protocol_name(evaluation)}; runs of one method "
                "are different policies, and several seeds of one go into one evaluation (--seeds)"
            )
        seen.add(key)
