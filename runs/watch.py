"""Watch a trained model at work: a video of it in a world, with what it looks at drawn in.

Each frame shows the world and what the camera sees, with the places that the decision reads,
taken from the meter: nothing is drawn that was not read.
"""

from __future__ import annotations

import os
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Any

import cv2
import numpy as np
import tyro
from PIL import Image

from attn_tree.tree.storage import ArchiveError
from attn_tree.vision.retina import Reading
from envs.render import camera_rectangle
from runs import cli, models
from runs.costs import decide
from runs.drawing import BLACK, WHITE, gaze_on
from runs.evaluation import exchanged_bank
from runs.methods import METHODS
from runs.playing import Percept, numbered
from runs.run import full_id, is_ours, make_env

VIEW = 384  # width of the camera's picture, pixels, beside a scene that shows none
FORMATS = (".mp4", ".gif")


def record_frames(model: Any, env: Any, world: Any, steps: int) -> list[np.ndarray]:
    """Frames of a model deciding greedily for `steps` steps, `(h, w, 3)` uint8 RGB, all of one size.

    Args:
        model: anything with SB3's `predict`.
        env: a batch of one, with `render_mode="rgb_array"`.
        world: its `World`, for the names of actions and the images behind indices; None for an
            environment that is none of ours.
        steps: number of frames.
    """
    frames = []
    observation, earned, episode = env.reset(), 0.0, 1
    state, starts = None, np.ones(1, bool)
    for _ in range(steps):
        seen = observation[0] if state is None else Percept(observation[0], state, starts)
        cost, _ms = decide(model, seen)
        readings = cost.ledgers[0].readings if cost.ledgers else []
        actions, state = model.predict(observation, state, starts, deterministic=True)
        scene = env.render()
        read = f"{cost.fraction:.1%} of the pixels" if cost.ledgers else "no pixels"
        name = (
            world.action_names[numbered(world, actions)[0]] if world is not None else f"action {actions[0]}"
        )
        text = f"episode {episode}, return {earned:+.1f}, reads {read}, goes {name}"
        frames.append(_frame(_with_gaze(scene, observation[0], world, readings), text))
        observation, rewards, dones, _infos = env.step(np.asarray(actions))
        starts = np.asarray(dones, bool)
        earned += float(rewards[0])
        if dones[0]:
            earned, episode = 0.0, episode + 1
    return _one_size(frames)


def write_video(frames: Sequence[np.ndarray], path: Path, fps: float) -> None:
    """Write frames as `.mp4` or `.gif`; the file appears whole or not at all.

    Raises:
        ValueError: another suffix, or OpenCV cannot encode here.
    """
    if path.suffix not in FORMATS:
        raise ValueError(f"{path}: a video ends in {' or '.join(FORMATS)}")
    path.parent.mkdir(parents=True, exist_ok=True)
    handle, name = tempfile.mkstemp(dir=path.parent, prefix=".watch.", suffix=path.suffix)
    os.close(handle)
    try:
        if path.suffix == ".gif":
            pictures = [Image.fromarray(frame).quantize(128) for frame in frames]
            pictures[0].save(
                name, save_all=True, append_images=pictures[1:], duration=round(1000 / fps), loop=0
            )
        else:
            _write_mp4(frames, name, fps)
        os.chmod(name, 0o644)
        os.replace(name, path)
    finally:
        Path(name).unlink(missing_ok=True)


def _write_mp4(frames: Sequence[np.ndarray], name: str, fps: float) -> None:
    height, width = frames[0].shape[:2]
    writer = cv2.VideoWriter(name, cv2.VideoWriter.fourcc(*"mp4v"), fps, (width, height))
    if not writer.isOpened():
        raise ValueError("this OpenCV cannot write mp4; give a .gif file instead")
    for frame in frames:
        writer.write(cv2.cvtColor(frame, cv2.COLOR_RGB2BGR))
    writer.release()


def _with_gaze(scene: np.ndarray, observation: Any, world: Any, readings: Sequence[Reading]) -> np.ndarray:
    """The scene with what was read drawn on the camera's picture: in its place in a scene of ours,
    beside another's. An observation that is no image (the hidden state) has no gaze."""
    observation = np.asarray(observation)
    if world is None:
        if observation.ndim != 3:
            return scene
        seen = gaze_on(observation, readings, VIEW)
        height = scene.shape[0]
        return np.concatenate(
            [scene, cv2.resize(seen, (seen.shape[1] * height // seen.shape[0], height))], axis=1
        )
    if readings and observation.ndim != 1:  # symbols are read nowhere in the picture
        x, y, width, height = camera_rectangle(world)
        image = observation if observation.ndim == 3 else world.images[int(observation)]
        scene = scene.copy()
        scene[y : y + height, x : x + width] = cv2.resize(gaze_on(image, readings, width), (width, height))
    return scene


def _frame(scene: np.ndarray, text: str) -> np.ndarray:
    """A scene with a line of text below."""
    height, width = scene.shape[:2]
    frame = cv2.copyMakeBorder(scene, 0, 34, 0, 0, cv2.BORDER_CONSTANT, value=WHITE)
    scale = min(0.55, width / (9.5 * len(text)) * 0.5)
    cv2.putText(frame, text, (16, height + 22), cv2.FONT_HERSHEY_SIMPLEX, scale, BLACK, 1, cv2.LINE_AA)
    return frame


def _one_size(frames: Sequence[np.ndarray]) -> list[np.ndarray]:
    """Frames padded to even sides of one size, as video encoders want."""
    height = max(frame.shape[0] for frame in frames)
    width = max(frame.shape[1] for frame in frames)
    height, width = height + height % 2, width + width % 2
    return [
        np.pad(f, ((0, height - f.shape[0]), (0, width - f.shape[1]), (0, 0)), constant_values=255)
        for f in frames
    ]


def main(
    model: Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="MODEL")],
    out: Path,
    env: str | None = None,
    env_set: tuple[str, ...] = (),
    heldout: bool = False,
    steps: int = 60,
    fps: float = 3.0,
    seed: int = 0,
) -> int:
    """Play a saved model in a world and write a video with its gaze drawn in.

    Args:
        model: a model.zip that runs.train or runs.compare wrote.
        out: file to write, .mp4 or .gif.
        env: registered id; the one that the model was trained in if not given.
        env_set: settings of the environment, key=value, over those of training.
        heldout: show the views kept out of training.
        steps: environment steps, one frame each.
        fps: frames per second.
        seed: of the environment.
    """
    from envs import REGISTERED

    if out.suffix not in FORMATS:
        raise cli.UserMistake(f"--out {out}: a video ends in {' or '.join(FORMATS)}")
    if steps < 1 or fps <= 0:
        raise cli.UserMistake("--steps must be at least 1 and --fps positive")
    with cli.mistakes_of(ArchiveError):
        origin = models.read_origin(model)
    if env is None and origin.env not in REGISTERED:  # making it may import what the file names
        raise cli.UserMistake(f"{model}: was trained in {origin.env!r}, none of ours; name it with --env")
    name = full_id(env or origin.env)
    settings = {**origin.env_settings, **cli.settings_from(env_set), "render_mode": "rgb_array"}
    method = METHODS[origin.method]
    with cli.mistakes():
        made = make_env(method, name, settings, 1, seed)
        loaded = models.load(model, made)
        if heldout:
            made = make_env(method, name, {**settings, "split": "heldout"}, 1, seed)
        world: Any = made.get_attr("world")[0] if is_ours(name) else None
        if heldout and method.obs == "index" and method.name != "Random":
            loaded = _Elsewhere(loaded, world.images)
        write_video(record_frames(loaded, made, world, steps), out, fps)
    print(out)
    return 0


class _Elsewhere:
    """An index model that is shown the images of another world, one at a time."""

    def __init__(self, model: Any, images: np.ndarray) -> None:
        self.model, self.images = model, images

    def predict(self, observation: np.ndarray, *memory: Any, **options: Any) -> Any:
        """As SB3's, for the number of one image of that world."""
        index = int(np.asarray(observation).ravel()[0])
        with exchanged_bank(self.model, self.images[index : index + 1]):
            return self.model.predict(np.zeros(np.shape(observation), int), *memory, **options)


if __name__ == "__main__":
    sys.exit(cli.main(main, "runs.watch"))
