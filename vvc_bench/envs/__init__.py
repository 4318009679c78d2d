"""Gymnasium environments. Importing `vvc_bench` registers their ids."""

import gymnasium

ENVIRONMENT_IDS = {
    "VVC/Normal-v0": "normal",
    "VVC/Medium-v0": "medium",
    "VVC/Hard-v0": "hard",
    "VVC/FlyCraft-v0": "flycraft",
}
"""Id → name in `vvc_bench.tasks.TASKS`. What an id means never changes: a changed number is a new version."""

SUB_GOALS_ID = "VVC/TurnClimb-v0"
"""Three goals in one episode (the paper's Fig. 5)."""


def register_environments() -> None:
    """Make the ids known to Gymnasium, unless they are already.

    No wrapper is put around the environments: they check their input themselves, and their time limit is part of the
    task.
    """
    for environment_id, task in ENVIRONMENT_IDS.items():
        if environment_id not in gymnasium.registry:
            gymnasium.register(
                environment_id,
                entry_point="vvc_bench.envs.environment:VelocityVectorEnv",
                vector_entry_point="vvc_bench.envs.vector:VelocityVectorVectorEnv",
                kwargs={"task": task},
                disable_env_checker=True,
                order_enforce=False,
            )
    if SUB_GOALS_ID not in gymnasium.registry:
        gymnasium.register(
            SUB_GOALS_ID,
            entry_point="vvc_bench.envs.sub_goals:SubGoalsEnv",
            vector_entry_point="vvc_bench.envs.sub_goals_vector:SubGoalsVectorEnv",
            kwargs={"task": "hard"},
            disable_env_checker=True,
            order_enforce=False,
        )
