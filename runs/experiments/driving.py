"""A driver who learns, and what is worth knowing about him; shared by the experiments of chapter 4.

What he has learned is scored exactly: decisions are weighed by how often the greedy policy meets
them within the time limit, or counted over everything behind a cross that the world can show.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

LIMIT = 100  # steps of an episode
WINDOW = 50  # episodes that figure 4.4 averages over
GAMMA = 0.9

# Kinds of situation by what is perceived; the sign matters where a light can be seen.
KINDS = (
    "two cells before a cross or three-way",
    "at a cross, light not seen",
    "at a cross, red",
    "at a cross, green",
    "in a cross, light seen",
    "straight road",
    "before or at a turn or side road",
)


def kinds() -> np.ndarray:
    """The number in `KINDS` of each perceptual state."""
    from envs.driving_rules import GO, PERCEPTS, RULES, STOP

    first, second, third = (RULES[number].occupied for number in (0, 1, 3))
    found = []
    for *occupied, sign in PERCEPTS:
        seen, shown = sign in (STOP, GO), tuple(occupied)
        if shown == second:
            found.append({STOP: 2, GO: 3}.get(sign, 1))
        elif shown == third:
            found.append(4 if seen else 5)
        else:
            found.append(0 if shown == first else 6)
    return np.array(found)


def greedy(model: Any, obs: str) -> np.ndarray:
    """Greedy actions `(N, 2)`, motor and attention, for every perceptual state."""
    from envs.driving_rules import PERCEPTS

    shown = np.array(PERCEPTS) if obs == "symbols" else np.arange(len(PERCEPTS))
    actions, _ = model.predict(shown, deterministic=True)
    return np.asarray(actions, int)


def follows(world: Any, actions: np.ndarray) -> np.ndarray:
    """`(S, V)` float: 1 where the actions follow the rule that applies, 0 not, NaN where none does."""
    from envs.driving_rules import RULES, rule_of

    applies = rule_of(world)
    wanted = np.array([(rule.motor, rule.attention) for rule in RULES])
    right = (actions[world.views] == wanted[applies]).all(axis=2)
    return np.where(applies < 0, np.nan, right)


def met(world: Any, actions: np.ndarray) -> np.ndarray:
    """`(S, V)`: how often the greedy policy meets each pair of a state and a view, per step of an episode."""
    policy = world.state_policy(np.ravel_multi_index(tuple(actions.T), world.action_shape))
    weight = policy[:, :, None] * world.probability
    move = np.zeros((world.n_states, world.n_states))
    rows = np.broadcast_to(np.arange(world.n_states)[:, None, None], weight.shape)
    np.add.at(move, (rows, world.next_state), weight)
    now, total = world.start.copy(), np.zeros(world.n_states)
    for _ in range(LIMIT):
        total, now = total + now, now @ move
    valid = np.arange(world.views.shape[1]) < world.n_views[:, None]
    return total[:, None] / LIMIT * valid / world.n_views[:, None]


def figures(model: Any, world: Any, obs: str) -> dict[str, Any]:
    """What a driver has learned: shares of decisions that follow the rules, reward, and where he looks.

    Returns:
        `rules` over decisions that the greedy policy meets, `rules_all` over all that the world can
        show, `behind` the share of met decisions to which a rule applies, `light` the share of
        met decisions under rules 1 and 2 that attend the light, `reward` per step and `optimum` of
        a driver who knows the state, `actions` by perceptual state, `looks` `(kinds, 7)`.
    """
    from envs.driving_rules import FR, rule_of

    actions = greedy(model, obs)
    right, weight, applies = follows(world, actions), met(world, actions), rule_of(world)
    ruled, lit = applies >= 0, (applies == 0) | (applies == 1)
    looks = np.zeros((len(KINDS), 7))
    kind = kinds()[world.views]
    np.add.at(looks, (kind, actions[world.views, 1]), weight)
    flat = np.ravel_multi_index(tuple(actions.T), world.action_shape)
    behind = float(weight[ruled].sum())
    return {
        "rules": float((weight * right)[ruled].sum() / behind) if behind else None,
        "rules_all": float(right[ruled].mean()),
        "behind": behind,
        "light": _share(weight, lit, actions[world.views, 1] == FR),
        "light_all": float((actions[world.views, 1] == FR)[lit].mean()),
        "reward": world.expected_return(world.state_policy(flat), LIMIT) / LIMIT,
        "optimum": world.optimal_return(LIMIT, GAMMA) / LIMIT,
        "actions": actions.tolist(),
        "looks": looks.round(6).tolist(),
    }


def _share(weight: np.ndarray, where: np.ndarray, which: np.ndarray) -> float | None:
    total = float(weight[where].sum())
    return float(weight[where & which].sum()) / total if total else None


def learn(model: Any, world: Any, steps: int, obs: str) -> list[dict[str, float]]:
    """Let a model learn; after each `WINDOW` episodes the mean reward per step, and the rules it follows.

    Returns:
        `steps`, `reward` earned while learning, `rules` over all that the world can show.
    """
    from stable_baselines3.common.callbacks import BaseCallback

    curve: list[dict[str, float]] = []

    class Curve(BaseCallback):
        earned, since = 0.0, 0

        def _on_step(self) -> bool:
            self.earned += float(self.locals["rewards"].sum())
            if self.num_timesteps - self.since >= WINDOW * LIMIT:
                reward = self.earned / (self.num_timesteps - self.since)
                rules = float(np.nanmean(follows(world, greedy(self.model, obs))))
                curve.append({"steps": self.num_timesteps, "reward": reward, "rules": rules})
                self.earned, self.since = 0.0, self.num_timesteps
            return True

    model.learn(steps, callback=Curve())
    return curve


def reached(curve: Sequence[Mapping[str, float]], share: float) -> float | None:
    """Steps after which the rules are first followed in this share of decisions; None if never."""
    return next((entry["steps"] for entry in curve if entry["rules"] >= share), None)


# Drawing --------------------------------------------------------------------------------------


def draw_curves(curves: Mapping[str, Sequence[Sequence[Mapping[str, float]]]], path: Path) -> None:
    """Reward per step while learning, and rules followed: median and quartiles over seeds, by name."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(8.4, 3.4), layout="constrained")
    panels = figure.subplots(1, 2)
    for name, runs in curves.items():
        length = min(map(len, runs))
        steps = [entry["steps"] / 1000 for entry in runs[0][:length]]
        for axes, what in zip(panels, ("reward", "rules"), strict=True):
            values = np.array([[entry[what] for entry in run[:length]] for run in runs])
            low, middle, high = np.quantile(values, [0.25, 0.5, 0.75], axis=0)
            (line,) = axes.plot(steps, middle, label=name, linewidth=1.4)
            axes.fill_between(steps, low, high, color=line.get_color(), alpha=0.15)
    panels[0].set_ylabel(f"reward per step, mean of {WINDOW} episodes")
    panels[1].set_ylabel("decisions that follow table 4.2")
    for axes in panels:
        axes.set_xlabel("thousand steps")
        axes.spines[["top", "right"]].set_visible(False)
    panels[1].legend(fontsize=7, frameon=False)
    figure.savefig(path, dpi=130)


def draw_gaze(map: str, actions: Sequence[Sequence[int]], path: Path) -> None:
    """The map, and from each cell that is driven to, the place at which the driver looks by then.

    Lines run from where the car has come to where it looks. Thick: behind a cross; orange when
    the light is looked at, red when something else is.

    Args:
        map: name of a map.
        actions: `(N, 2)` by perceptual state.
        path: file to write.
    """
    from matplotlib.figure import Figure

    from envs.driving import Drive
    from envs.driving_rules import FR, NOTHING, NULL, PERCEPTS
    from envs.road_grids import MAPS, Pose, parse_roads

    roads = parse_roads(MAPS[map])
    drive, number = Drive(roads, frozenset()), {percept: i for i, percept in enumerate(PERCEPTS)}
    rows, columns = roads.shape
    figure = Figure(figsize=(0.42 * columns, 0.42 * rows), layout="constrained")
    axes = figure.subplots()
    ground = np.full((rows, columns, 3), (222, 232, 210), np.uint8)
    for cell in roads.cells:
        ground[cell] = (150, 153, 160)
    axes.imshow(ground)
    for row, column in roads.posts:
        axes.plot(column, row, "o", color="#333", markersize=5, zorder=2)
    for cell in sorted(roads.cells):
        for heading in roads.ways(cell):
            pose = Pose(cell, heading)
            if not roads.straight(cell) and cell not in roads.crosses:
                continue
            motor, attention = actions[number[(*roads.occupied(pose), NOTHING)]]
            to = drive.target(pose, motor) or pose
            if attention == NULL:
                continue
            (y, x), (v, u) = _lane(to), to.cell_at(attention)
            first = roads.position(pose) == 1
            colour = "#6b7fb3" if not first else "#e67e22" if attention == FR else "#c0392b"
            width, alpha = (2.2, 1.0) if first else (0.7, 0.5)
            axes.plot([x, u], [y, v], color=colour, linewidth=width, alpha=alpha, zorder=3 if first else 1)
            axes.plot(x, y, ".", color=colour, markersize=7 if first else 3, alpha=alpha, zorder=4)
    axes.set_xlim(-0.5, columns - 0.5)
    axes.set_ylim(rows - 0.5, -0.5)
    axes.set_axis_off()
    axes.set_title("from where to where he looks; orange: at the light behind a cross", fontsize=8)
    figure.savefig(path, dpi=130)


def _lane(pose: Any) -> tuple[float, float]:
    """Where on its cell a car is drawn: on the right, so that the two directions do not hide each other."""
    (row, column), (dr, dc) = pose.cell, ((0, 1), (1, 0), (0, -1), (-1, 0))[pose.heading]
    return row + 0.22 * dr, column + 0.22 * dc
