"""Beside figure 8.14: a recurrent network where cells that want different actions show one image (8.4.3).

`RecurrentPPO` of sb3-contrib is told the *number* of the image, one-hot, where trees have to look: that
favours it. Its policy is no function of a window of fixed depth, so it is scored by playing it out from
every cell in which an episode may begin, which is exact in a world without chance.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from runs.experiments.chapter8_history import EQUAL, GRIDS
from runs.experiments.experiment import Experiment, Line, Lines, Table, Unit, mean_interval, select
from runs.experiments.growing import GAMMA, SEEDS

INPUTS = ("images", "images and actions")
STARTS = "unshared"
STEPS = 49_152  # 48 rollouts
N_ENVS = 64
UNITS = 64
HORIZON = 100  # the time limit; γ^100 is below 10^-9


def _units() -> list[Unit]:
    return [
        Unit(
            f"{grid}-{seen.replace(' ', '-')}-{seed}",
            {"grid": grid, "inputs": seen, "steps": STEPS, "units": UNITS, "starts": STARTS, "seed": seed},
        )
        for grid in GRIDS
        for seen in INPUTS
        for seed in range(SEEDS)
    ]


def compute(unit: Unit, lines: Lines) -> dict[str, Any]:
    """Exact discounted return of the greedy policy, beside what memory can earn and what none can."""
    from baselines.recurrent import LstmPPO, WithLastAction
    from envs.bounds import belief_bound, memory_bound
    from envs.sb3 import make_vec

    settings = unit.settings
    seed = settings["seed"]
    venv = make_vec(
        GRIDS[settings["grid"]],
        n_envs=N_ENVS,
        seed=seed,
        obs="index",
        bank="rendered",
        bank_seed=seed,
        heldout_views=0,
        starts=settings["starts"],
    )
    world = venv.get_attr("world")[0]
    told = WithLastAction(venv) if settings["inputs"] == "images and actions" else None
    model = LstmPPO(told or venv, units=settings["units"], seed=seed, gamma=GAMMA)
    model.learn(settings["steps"])
    return {
        "earned": played(model, world, told),
        "any": belief_bound(world, GAMMA),
        "none": memory_bound(world, 0, GAMMA),
        "steps": model.num_timesteps,
    }


def played(model: Any, world: Any, told: Any = None, gamma: float = GAMMA, horizon: int = HORIZON) -> float:
    """Expected discounted return of a greedy policy with a state, played once from every start.

    Args:
        model: its `predict` takes and gives the state.
        world: without chance, one image per state.
        told: a `WithLastAction` that makes its observations; None if it sees numbers of images.
        gamma: discount.
        horizon: steps after which an episode is cut.

    Raises:
        ValueError: chance decides what follows or what is seen: one episode per start is not enough.
    """
    import numpy as np

    if world.next_state.shape[2] > 1 or (world.n_views > 1).any():
        raise ValueError("one episode per start scores worlds without chance only: one successor, one view")
    starts = np.flatnonzero(world.start)
    state, actions, memory = starts, np.full(len(starts), -1), None
    earned, going = np.zeros(len(starts)), np.ones(len(starts), bool)
    for step in range(horizon):
        seen = world.views[state, 0]
        observations = seen if told is None else told.beside(seen, actions)
        begins = np.full(len(starts), step == 0)
        actions, memory = model.predict(observations, state=memory, episode_start=begins, deterministic=True)
        earned += going * gamma**step * world.reward[state, actions, 0]
        state = world.next_state[state, actions, 0]
        going &= ~world.terminal[state]
        if not going.any():
            break
    return float(world.start[starts] @ earned)


def score(lines: Sequence[Line]) -> list[Table]:
    """By grid and by what the network is told: how often it earns what any memory can."""
    rows: list[list[Any]] = []
    for grid in GRIDS:
        for seen in INPUTS:
            found = select(lines, grid=grid, inputs=seen)
            if not found:
                continue
            earned = [line.scores["earned"] for line in found]
            best = found[0].scores["any"]
            reached = sum(value >= best - EQUAL for value in earned)
            above = sum(value > found[0].scores["none"] + EQUAL for value in earned)
            rows.append(
                [
                    grid,
                    seen,
                    f"{reached} / {len(found)}",
                    mean_interval(earned),
                    min(earned),
                    best,
                    found[0].scores["none"],
                    f"{above} / {len(found)}",
                ]
            )
    head = [
        "grid",
        "told",
        "at the bound / seeds",
        "return, γ 0.8",
        "worst seed",
        "bound, any memory",
        "bound, no memory",
        "above no memory / seeds",
    ]
    caption = (
        "RecurrentPPO, episodes that begin outside the shared image; figure 8.14 has the trees in the "
        "same grids."
    )
    return [Table(head, rows, caption)]


EXPERIMENTS = [
    Experiment(
        name="figure-8.14-recurrent",
        chapter=8,
        title="A recurrent network in the grids of figure 8.14",
        section="beside 8.4.3, figure 8.14",
        claim="Nothing in the thesis; what a network reaches that learns by itself what to remember.",
        units=_units(),
        compute=compute,
        score=score,
        deviations=(
            "The network is told the number of each image, one-hot: it need not look nor tell images apart. "
            "Trees in figure 8.14 read pixels.",
            "RecurrentPPO hands its LSTM observations alone; 'images and actions' adds the action before, "
            "which windows of figure 8.14 hold.",
            f"One LSTM of {UNITS} units serves policy and value; {STEPS:,} steps where trees had 100,000. "
            "Settings were chosen on seeds 100 to 102, after a trial of others on seeds 0 and 1.",
            f"Scored is the greedy policy, played from every cell where an episode may begin, cut after "
            f"{HORIZON} steps.",
            "'Any memory' is the optimum over all that was seen and done, 'no memory' that of deterministic "
            "policies over the present image.",
        ),
        cpu_minutes=15,
    ),
]
