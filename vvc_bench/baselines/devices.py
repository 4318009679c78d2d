"""Where networks are trained: the processor, or an accelerator."""

import torch

AUTO = "auto"
CPU = torch.device("cpu")


def find_device(name: str) -> torch.device:
    """A device by PyTorch's name for it.

    Args:
        name: as ``cpu``, ``cuda``, ``cuda:1`` or ``mps``; ``auto`` is CUDA's current device where there is one, and
            else the processor.

    Raises:
        ValueError: if it is not here, or PyTorch knows none of that name.
    """
    if name == AUTO:
        return torch.device("cuda" if torch.cuda.is_available() else "cpu")
    try:
        tried = torch.zeros(1, device=name)
        tried.item()  # not all that hold tensors hold values
    except (RuntimeError, AssertionError) as error:  # the latter where PyTorch was built without CUDA
        reason = str(error).splitlines()[0]
        raise ValueError(f"networks cannot be trained on {name!r} here: {reason}; choose cpu, or {AUTO}") from error
    return tried.device
