"""What learners are trained with, named after where the figures come from.

Sources: the paper's Table 7, and the configuration files of its public repository ``GongXudong/fly-craft-examples``
(``configs/train/IRPO``, ``configs/train/VVCGym``, ``train_scripts/train_with_rl_ppo.py``), called *released* here.
"""

from typing import NamedTuple

HIDDEN = (128, 128)
"""Widths of the hidden layers, of policy and value function each; Tanh between them."""


class CloningConfiguration(NamedTuple):
    """Behavioural cloning."""

    epochs: int = 300
    batch_size: int = 4096
    learning_rate: float = 1e-3
    """Adam's, in the library; the paper names none."""
    entropy_weight: float = 1e-2
    l2_weight: float = 0.0
    hidden: tuple[int, ...] = HIDDEN


class PpoConfiguration(NamedTuple):
    """Proximal policy optimisation."""

    steps: int = 200_000_000
    environments: int = 64
    steps_of_a_rollout: int = 2048
    """Of each environment."""
    batch_size: int = 4096
    epochs: int = 5
    discount: float = 0.995
    learning_rate: float = 3e-4
    """At the start; it falls linearly to 0."""
    entropy_weight: float = 0.0
    clip_range: float = 0.2
    advantage_smoothing: float = 0.95
    """λ of generalised advantages; the library's."""
    state_dependent_exploration: bool = True
    demonstrator_penalty: float = 0.0
    """Weight of KL(demonstrator ‖ policy), mean over batch and action components; 0 for plain fine-tuning."""
    warm_up_steps: int = 0
    """Steps in which only the value function learns."""
    hidden: tuple[int, ...] = HIDDEN


class SacConfiguration(NamedTuple):
    """Soft actor-critic."""

    steps: int = 1_000_000
    environments: int = 1
    batch_size: int = 1024
    buffer_size: int = 200_000
    learning_starts: int = 10_240
    discount: float = 0.995
    learning_rate: float = 3e-4
    gradient_steps: int = 1
    hindsight: bool = False
    hidden: tuple[int, ...] = HIDDEN


GCBC_RELEASED = CloningConfiguration()
PPO_RELEASED = PpoConfiguration()
SAC_RELEASED = SacConfiguration()
SAC_HER_RELEASED = SacConfiguration(hindsight=True)
IRPO_1_RELEASED = PpoConfiguration(demonstrator_penalty=1e-3, warm_up_steps=20_000_000)
IRPO_2_RELEASED = IRPO_1_RELEASED._replace(demonstrator_penalty=1e-1)
IRPO_3_RELEASED = IRPO_2_RELEASED._replace(steps=500_000_000, hidden=(256, 256, 128, 128, 64))
"""From the third iteration on the released networks are deeper, and trained for longer."""

PPO_FAST = PpoConfiguration(
    steps=50_000_000,
    environments=1024,
    steps_of_a_rollout=128,
    batch_size=16_384,
    state_dependent_exploration=False,
)
"""Ours: the same number of steps between two updates with more aircraft, and larger batches, for few cores."""
