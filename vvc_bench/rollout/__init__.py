"""Many flights at once: the loop that flies them, and the value that holds them."""

from vvc_bench.rollout.episodes import Episodes, concatenate
from vvc_bench.rollout.policies import Policy, fly_policy
from vvc_bench.rollout.replay import Flown, fly_law, replay
from vvc_bench.rollout.scenario import Scenario

__all__ = ["Episodes", "Flown", "Policy", "Scenario", "concatenate", "fly_law", "fly_policy", "replay"]
