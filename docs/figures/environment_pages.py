"""The tables and figures of the environments' pages: their rules from their definitions, and how hard they are.

python docs/figures/environment_pages.py           # rewrite the tables and figures of docs/environments.md and below
python docs/figures/environment_pages.py --check   # exit with 1 if a table of rules is stale
"""

import argparse
import sys
from typing import NamedTuple

import gymnasium
import numpy as np
from figure_tools import COLOURS, DOCS, INK, Array, finish, new_figure, report, save, table, with_tables
from flight_gif import fly
from matplotlib.figure import Figure

from vvc_bench import sim
from vvc_bench.envs import ENVIRONMENT_IDS, SUB_GOALS_ID
from vvc_bench.envs.sub_goals import TURN_CLIMB
from vvc_bench.experts import APPENDIX_C, WEIGHT_COMPENSATED, PidParameters
from vvc_bench.goals import UniformBox
from vvc_bench.rollout import Flown, Scenario, fly_law, fly_policy
from vvc_bench.sim.task import Event, Rules, Task
from vvc_bench.tasks import TASKS, Problem

PAGES = {task: f"environments/{task}.md" for task in TASKS}
SUB_GOALS_PAGE, COMMON_PAGE = "environments/turn-climb.md", "environments.md"
PAPERS_TASKS = ("normal", "hard")
GOALS = 20_000
GOALS_FOR_CHANCE = 2_000
BINS = 14
LAWS = {"PID, Appendix C": APPENDIX_C, "PID, weight compensated": WEIGHT_COMPENSATED}
NONE = "–"


class Rule(NamedTuple):
    """One row of the table of rules; numbers of the task stand in braces."""

    name: str
    keywords: tuple[str, ...]
    paper: str
    public_code: str = "the same"


RULES = (
    Rule(
        "reached (RT)",
        ("reach_steps", "speed_band_mps", "direction_band_deg"),
        "each of the last {reach_steps} reports within {speed_band_mps} m/s and {direction_band_deg}°",
        "the *mean* of the last {reach_steps} within them, the first report counted: after {reach_steps_less_1} steps "
        "at the earliest",
    ),
    Rule("crash (C)", ("least_altitude_m",), "altitude below {least_altitude_m} m", "the same; also `truncated`"),
    Rule(
        "extreme state (ES)",
        ("largest_speed_mps", "largest_roll_rate_degps"),
        "over {largest_speed_mps} m/s or {largest_roll_rate_degps} deg/s",
        "the same; also `truncated`",
    ),
    Rule(
        "moving away (CMA)",
        ("move_away_steps",),
        "angle between the velocity vectors growing {move_away_steps} steps in a row",
        "path-angle error *and* azimuth error growing {move_away_steps} steps in a row, each ignored below 1°",
    ),
    Rule("rolling on (CR)", ("largest_roll_on_deg",), "over {largest_roll_on_deg}° in one direction"),
    Rule(
        "negative load, banked (NOBR)",
        ("least_load_factor_g", "steep_bank_deg", "negative_load_steps"),
        "load factor below {least_load_factor_g} g beyond {steep_bank_deg}° of bank, {negative_load_steps} steps in a "
        "row",
    ),
    Rule(
        "time (T)",
        ("step_limit",),
        "after exactly {step_limit} steps, `truncated` alone, not punished",
        "after {step_limit_less_1}, `terminated` and `truncated`, {constant_penalty}",
    ),
    Rule("order if several coincide", ("terminations",), "RT, then failures, then T", "RT, C, ES, T, CMA, CR, NOBR"),
    Rule("reward on reaching", ("reward",), "0", "the dense reward"),
    Rule("reward on failing", ("reward",), "the penalty alone", "the penalty and the dense reward"),
    Rule(
        "penalty",
        ("penalty", "discount", "constant_penalty"),
        '−(1 − γ^(T_max − t)) / (1 − γ), γ = {discount}; `penalty="constant"`: {constant_penalty}',
    ),
    Rule(
        "reward otherwise (dense)",
        ("speed_weight", "direction_weight", "speed_scale_mps", "direction_scale_deg", "exponent"),
        "−({speed_weight} min(\\|Δv\\| / {speed_scale_mps}, 1)^{exponent} + "
        "{direction_weight} (∠ / {direction_scale_deg}°)^{exponent})",
    ),
)


def numbers(task: Task) -> dict[str, str]:
    """The task's fields by column name, as they are written."""
    values = {
        name: value * field.unit.scale for (name, field), value in zip(sim.columns(Task).items(), task, strict=True)
    }
    values |= {f"{name}_less_1": values[name] - 1 for name in ("reach_steps", "step_limit")}
    return {name: f"{value:g}".replace("-", "−") for name, value in values.items()}


def box_text(box: UniformBox) -> str:
    speed, path_angle, azimuth = zip(box.low, box.high, strict=True)
    return f"{speed[0]:g}..{speed[1]:g} m/s · ±{path_angle[1]:g}° · ±{azimuth[1]:g}°"


def sub_goals_text() -> str:
    return ", then ".join(
        f"({speed:g} m/s, {path_angle:g}°, {azimuth:g}°)" for speed, path_angle, azimuth in TURN_CLIMB
    )


def goals_row(page: str) -> list[str]:
    """Where goals come from: paper, public code, here."""
    name, public_code = "goals: speed · path angle · azimuth", box_text(TASKS["flycraft"].goals)
    if page == SUB_GOALS_PAGE:
        return [name, "`sub_goals`", "a level turn, a straight acceleration, a climb (Fig. 5)", NONE, sub_goals_text()]
    task = next(task for task, path in PAGES.items() if path == page)
    here = box_text(TASKS[task].goals)
    return [name, "`goals`", here if task in PAPERS_TASKS else NONE, public_code, here]


def rules_table(page: str, task: Task) -> str:
    """Paper, public code, and which of them holds here."""
    public = task.rules == Rules.PUBLIC_CODE
    rows = [goals_row(page)]
    for rule in RULES:
        here = ("public code" if public else "paper") if rule.public_code != "the same" else "the same"
        keywords = ", ".join(f"`{keyword}`" for keyword in rule.keywords)
        texts = (text.format(**numbers(task)) for text in (rule.paper, rule.public_code))
        rows.append([rule.name, keywords, *texts, here])
    return table(["", "keywords", "paper", "public code", "here"], rows, numbers=False)


def overview() -> str:
    """The ids, each with a link to its page."""
    rows = []
    for environment_id, task in ENVIRONMENT_IDS.items():
        rules = "public code" if TASKS[task].task.rules == Rules.PUBLIC_CODE else "paper"
        rows.append([f"[`{environment_id}`]({PAGES[task]})", f"uniform in {box_text(TASKS[task].goals)}", rules])
    rows.append([f"[`{SUB_GOALS_ID}`]({SUB_GOALS_PAGE})", sub_goals_text(), "paper"])
    return table(["id", "goals: speed · path angle · azimuth", "rules"], rows, numbers=False)


def tables_by_page() -> dict[str, dict[str, str]]:
    """What follows from definitions alone: page, then table."""
    tables = {page: {"rules": rules_table(page, TASKS[task].task)} for task, page in PAGES.items()}
    tables |= {SUB_GOALS_PAGE: {"rules": rules_table(SUB_GOALS_PAGE, TASKS["hard"].task)}}
    return tables | {COMMON_PAGE: {"overview": overview()}}


def ended_by(task: Task, events: np.ndarray) -> np.ndarray:
    """The event that each flight's end goes by: the first in the order of the rules."""
    if task.rules != Rules.PUBLIC_CODE:
        events = np.where(events == int(Event.TIME_LIMIT), events, events & ~int(Event.TIME_LIMIT))
    return events & -events


def chance(scenario: Scenario, goals: Array) -> Flown:
    """Flown by actions uniform in their space, another one in each step."""
    rng = np.random.default_rng(1)
    fields = sim.columns(scenario.settings.command_fields).values()
    low, high = np.array([(field.low * field.unit.scale, field.high * field.unit.scale) for field in fields]).T
    return fly_policy(scenario, goals, lambda seen: rng.uniform(low, high, (len(seen["observation"]), len(low))))


def difficulty_row(name: str, task: Task, flown: Flown) -> list[str]:
    ends = ended_by(task, flown.last_events)
    shares = [f"{100 * np.mean(ends == event):.1f}" for event in Event]
    lengths = flown.episodes.lengths
    return [name, shares[0], f"{np.median(lengths):g}" if len(lengths) else NONE, *shares[1:]]


def draw(goals: Array, reached: dict[str, np.ndarray], box: UniformBox, name: str) -> None:
    """Share of goals reached: by direction for each law, by speed for both."""
    figure: Figure = new_figure(9.6, 3.3)
    panels = figure.subplots(1, 3)
    speed, path_angle, azimuth = (np.linspace(low, high, BINS + 1) for low, high in zip(box.low, box.high, strict=True))
    for axes, (law, there) in zip(panels, reached.items(), strict=False):
        every, hits = (
            np.histogram2d(goals[which, 2], goals[which, 1], bins=(azimuth, path_angle))[0]
            for which in (slice(None), there)
        )
        image = axes.pcolormesh(azimuth, path_angle, 100 * (hits / every).T, vmin=0, vmax=100, cmap="viridis")
        finish(axes, x="azimuth, °", y="path angle, °" if axes is panels[0] else "", title=law.removeprefix("PID, "))
    bar = figure.colorbar(image, ax=panels[:2], pad=0.02)
    bar.set_label("reached, %", size=11, color=INK)
    middle = (speed[1:] + speed[:-1]) / 2
    for (law, there), colour, line in zip(reached.items(), COLOURS, ("-", "--"), strict=False):
        every, hits = (np.histogram(goals[which, 0], bins=speed)[0] for which in (slice(None), there))
        panels[2].plot(
            middle, 100 * hits / every, color=colour, linestyle=line, label=law.removeprefix("PID, "), linewidth=2
        )
    finish(panels[2], x="speed, m/s", y="reached, %", title="by speed")
    panels[2].set_ylim(0, 102)
    panels[2].legend(frameon=False, fontsize=9)
    save(figure, f"goals_{name}.png")


def difficulty(name: str, problem: Problem) -> str:
    """How flights to goals of the problem's own box end."""
    scenario, rng = Scenario(problem.task), np.random.default_rng(0)
    goals = np.array([problem.goals.sample(rng) for _ in range(GOALS)])
    flights = {law: fly_law(scenario, goals, parameters) for law, parameters in LAWS.items()}
    reached = {law: (flown.last_events & int(Event.REACH_TARGET)) != 0 for law, flown in flights.items()}
    draw(goals, reached, problem.goals, name)
    flights["random, guidance"] = chance(scenario, goals[:GOALS_FOR_CHANCE])
    end_to_end = Scenario(problem.task, sim.Settings(control_mode="end_to_end"))
    flights["random, end-to-end"] = chance(end_to_end, goals[:GOALS_FOR_CHANCE])
    header = ["pilot", "reached, %", "steps to it, median", "C, %", "ES, %", "T, %", "CMA, %", "CR, %", "NOBR, %"]
    return table(header, [difficulty_row(law, problem.task, flown) for law, flown in flights.items()])


def sub_goals_by_law(parameters: PidParameters) -> list[str]:
    """The step in which each sub-goal is reached, and how it ends."""
    episode = fly(parameters)
    steps = [int(np.argmax(episode.reached > k)) for k in range(len(TURN_CLIMB))]
    return [*(str(step or NONE) for step in steps), episode.termination]


def sub_goals_by_chance(control_mode: str) -> list[str]:
    """Share of flights that reach each sub-goal, and how most end."""
    environments = gymnasium.make_vec(
        SUB_GOALS_ID,
        num_envs=GOALS_FOR_CHANCE,
        vectorization_mode="vector_entry_point",
        autoreset_mode="Disabled",
        control_mode=control_mode,
    )
    environments.reset(seed=0)
    environments.action_space.seed(0)
    events, reached = np.zeros((2, GOALS_FOR_CHANCE), dtype=np.int64)
    while not events.all():
        *_, infos = environments.step(environments.action_space.sample())
        flying = events == 0
        events[flying], reached[flying] = infos["events"][flying], infos["sub_goals_reached"][flying]
    ends, counts = np.unique(ended_by(environments.unwrapped.task, events), return_counts=True)
    most = f"{str(Event(int(ends[counts.argmax()])).name).lower()}, {100 * counts.max() / counts.sum():.1f} %"
    return [*(f"{100 * np.mean(reached > k):.1f} %" for k in range(len(TURN_CLIMB))), most]


def sub_goals_difficulty() -> str:
    rows = [[law, *sub_goals_by_law(parameters)] for law, parameters in LAWS.items()]
    rows += [
        ["random, guidance", *sub_goals_by_chance("guidance")],
        ["random, end-to-end", *sub_goals_by_chance("end_to_end")],
    ]
    return table(["pilot", "turn", "acceleration", "climb", "ends by"], rows)


def check(pages: dict[str, dict[str, str]]) -> None:
    for page, tables in pages.items():
        text = (DOCS / page).read_text(encoding="utf-8")
        if with_tables(text, tables) != text:
            sys.exit(f"docs/{page} is stale: run python docs/figures/environment_pages.py")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--check", action="store_true", help="write nothing; exit with 1 if a table of rules is stale")
    pages = tables_by_page()
    if parser.parse_args().check:
        check(pages)
        return
    for page, tables in pages.items():
        report(page, tables)
    for task, page in PAGES.items():
        report(page, {"difficulty": difficulty(task, TASKS[task])})
    report(SUB_GOALS_PAGE, {"difficulty": sub_goals_difficulty()})


if __name__ == "__main__":
    main()
