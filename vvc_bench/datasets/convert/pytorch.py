"""Transitions for PyTorch (extra ``torch``)."""

from collections.abc import Sequence

import numpy as np

from vvc_bench.datasets.transitions import Transitions

try:
    import torch
    from torch.utils.data import Dataset
except ImportError as error:
    raise ImportError("this takes PyTorch, which is missing: pip install vvc-bench[torch]") from error


class TransitionDataset(Dataset):  # type: ignore[misc]  # whose type is not there without the extra
    """Transitions one by one, or many at once where asked for a list of rows.

    Whole batches are much faster: ``DataLoader(data, batch_size=None, sampler=BatchSampler(RandomSampler(data), 256,
    drop_last=True))``.

    Args:
        transitions: from ``dataset.transitions()``, or from ``dataset.memory_mapped()`` to leave them on the disk.
    """

    def __init__(self, transitions: Transitions) -> None:
        self.transitions = transitions

    def __len__(self) -> int:
        return len(self.transitions.rewards)

    def __getitem__(self, rows: int | Sequence[int]) -> dict[str, torch.Tensor]:
        """The fields of `Transitions` as tensors, with a first dimension where ``rows`` is a list."""
        return to_tensors(self.transitions.batch(rows))


def to_tensors(transitions: Transitions) -> dict[str, torch.Tensor]:
    """Transitions as tensors of their own, by field name."""
    return {name: torch.from_numpy(np.array(values)) for name, values in transitions._asdict().items()}
