"""Where an image is looked at: draw its saliency, every map on the way, and the first fixations.

python -m runs.look photo.jpg --out maps.png
python -m runs.look photo.jpg --out maps.png --gains gains.json    # as runs.gains learned them
"""

from __future__ import annotations

import sys
from dataclasses import asdict
from pathlib import Path
from typing import Annotated, Literal

import tyro

from runs import cli


def main(
    image: Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="IMAGE")],
    out: Path,
    gains: Path | None = None,
    model: Literal["revised", "basic"] = "revised",
    resolution: float | None = None,
    n: int = 3,
    radius: float | None = None,
) -> int:
    """Draw the saliency of an image with its first fixations, and print where they are.

    Args:
        image: file with a picture.
        out: figure to write, PNG, SVG or PDF.
        gains: file of learned gains; all weights one if not given.
        model: revised, or basic, which cannot be biased.
        resolution: of the maps relative to the image; that of the gains, or 1.
        n: number of fixations.
        radius: of inhibition of return, pixels; a twelfth of the longer side if not given.
    """
    from attn_tree.gains import LearnedGains, SaliencySettings
    from attn_tree.vision.drawing import draw_maps
    from attn_tree.vision.retina import Retina, meter
    from attn_tree.vision.saliency import saliency_maps
    from envs.tagged import read_image

    if n < 1:
        raise cli.UserMistake(f"--n is {n}; expected at least 1 fixation")
    with cli.mistakes():
        if out.suffix.lower() not in (".png", ".svg", ".pdf"):
            raise ValueError(f"--out is {out}; expected a name that ends in .png, .svg or .pdf")
        pixels = read_image(image)
        learned = None if gains is None else LearnedGains.load(gains)
        settings = asdict(SaliencySettings() if learned is None else learned.saliency)
        if resolution is not None:
            settings["resolution"] = resolution
        reach = max(pixels.shape[:2]) / 12 if radius is None else radius
        with meter() as cost:
            weights = None if learned is None else learned.gains
            maps = saliency_maps(Retina(pixels), weights, model, **settings)
            places = maps.fixations(n, reach)
        out.parent.mkdir(parents=True, exist_ok=True)
        draw_maps(pixels, maps, places, out, radius=reach)
    for order, (x, y) in enumerate(places, 1):
        print(f"{order}. x {x:.0f}, y {y:.0f}")
    if not len(places):
        print("nothing is salient: the image is the same everywhere")
    print(f"cost u · C̄ {maps.cost} of 52, {cost.fraction:.3g} of the image's pixels read; written to {out}")
    return 0


if __name__ == "__main__":
    sys.exit(cli.main(main, "runs.look"))
