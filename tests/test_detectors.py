"""Detectors: is the object in the scene? And the linear machines that they decide by."""

from __future__ import annotations

from dataclasses import asdict, replace
from pathlib import Path
from typing import NamedTuple

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from attn_tree.clpso import CLPSOSettings
from attn_tree.detectors import Detectors, DetectorSettings, places, thesis
from attn_tree.recognition import LinearMachines, best_threshold, train_machines
from attn_tree.tree.storage import ArchiveError, read_archive, write_archive
from attn_tree.vision.hmax import c2, fixed_dictionary
from attn_tree.vision.retina import Retina, meter
from attn_tree.vision.saliency import saliency_map
from attn_tree.vision.weights import Gains
from runs import cli
from runs.detectors import Asked, shares
from runs.detectors import main as command

SWARM = CLPSOSettings(particles=10, iterations=2)
SETTINGS = DetectorSettings(fixations=2, prototypes=20, colour=False, jitter=1)
WIDTH, HEIGHT = 160, 120


class Scene(NamedTuple):
    image: np.ndarray
    centers: np.ndarray


def scene(name: str | None, seed: int) -> Scene:
    """A noisy ground, and a red cross, a blue ring or nothing on it."""
    rng = np.random.default_rng(seed)
    image = rng.integers(90, 130, (HEIGHT, WIDTH, 3), dtype=np.uint8)
    x, y = (int(value) for value in rng.integers((28, 28), (WIDTH - 28, HEIGHT - 28)))
    if name == "cross":
        cv2.line(image, (x - 14, y), (x + 14, y), (220, 20, 20), 9)
        cv2.line(image, (x, y - 14), (x, y + 14), (220, 20, 20), 9)
    elif name == "ring":
        cv2.circle(image, (x, y), 14, (20, 20, 220), 7)
    return Scene(image, np.array([[x, y]], float))


@pytest.fixture(scope="module")
def detectors() -> Detectors:
    tagged = {name: [scene(name, 10 * i + k) for i in range(5)] for k, name in enumerate(("cross", "ring"))}
    return Detectors.train(tagged, rng=np.random.default_rng(0), settings=SETTINGS, swarm=SWARM)


def test_objects_never_seen_before_are_found_and_others_are_not(detectors: Detectors) -> None:
    assert detectors.names == ("cross", "ring")
    wrong = 0
    for name in detectors.names:
        for seed in range(500, 504):
            for shown in ("cross", "ring"):
                wrong += detectors.present(name, Retina(scene(shown, seed).image)) != (name == shown)
    assert wrong <= 1
    place, score = detectors.look("ring", Retina(scene("ring", 600).image))
    assert score > 0 and np.linalg.norm(np.array(place) - scene("ring", 600).centers[0]) < 12


def test_a_look_pays_for_its_map_and_each_window(detectors: Detectors) -> None:
    with meter() as cost:
        detectors.present("ring", Retina(scene("ring", 600).image))
        assert cost.selection == WIDTH // 4 * (HEIGHT // 4) and cost.recognition == 2500
    with meter() as cost:
        retina = Retina(scene("cross", 601).image)
        detectors.present("ring", retina)
        n = len(places(Retina(scene("cross", 601).image), detectors.gains["ring"], SETTINGS))
        assert cost.recognition == 2500 * n
        before = cost.operations["macs"]
        detectors.present("cross", retina)
        assert cost.ledgers[0].values("selection") == 2 * (WIDTH // 4 * (HEIGHT // 4))
        assert cost.operations["macs"] > before


def test_scores_say_what_present_says(detectors: Detectors) -> None:
    for seed in range(700, 704):
        image = scene("ring" if seed % 2 else "cross", seed).image
        scores = detectors.scores(image)
        for name, score in zip(detectors.names, scores, strict=True):
            assert detectors.present(name, Retina(image)) == (score > 0)


def test_the_same_seed_gives_the_same_bits_and_a_file_keeps_them(
    detectors: Detectors, tmp_path: Path
) -> None:
    tagged = {name: [scene(name, 10 * i + k) for i in range(5)] for k, name in enumerate(("cross", "ring"))}
    rng = np.random.default_rng(0)
    again = Detectors.train(tagged, rng=rng, settings=SETTINGS, gains=detectors.gains)
    again.save(tmp_path / "detectors.zip")
    stored = Detectors.load(tmp_path / "detectors.zip")
    assert stored.settings == SETTINGS and stored.gains == detectors.gains
    np.testing.assert_array_equal(stored.machines.weights, detectors.machines.weights)
    image = scene("ring", 800).image
    assert stored.look("ring", Retina(image)) == detectors.look("ring", Retina(image))


def test_damaged_files_are_refused_in_one_line(detectors: Detectors, tmp_path: Path) -> None:
    path = tmp_path / "detectors.zip"
    detectors.save(path)
    meta, arrays = read_archive(path)
    write_archive(path, {**meta, "format": "something else"}, arrays)
    with pytest.raises(ArchiveError, match="holds no detectors"):
        Detectors.load(path)
    write_archive(path, {**meta, "names": ["ring"]}, arrays)
    with pytest.raises(ArchiveError, match="damaged detectors"):
        Detectors.load(path)
    write_archive(path, meta, {**arrays, "weights": arrays["weights"][:, :-1]})
    with pytest.raises(ArchiveError, match="damaged detectors"):
        Detectors.load(path)


def test_the_thesis_looks_once_at_the_most_salient_place(detectors: Detectors) -> None:
    tagged = {name: [scene(name, 10 * i + k) for i in range(3)] for k, name in enumerate(("cross", "ring"))}
    rng = np.random.default_rng(0)
    plain = Detectors.train(tagged, rng=rng, settings=thesis(), gains=detectors.gains)
    image, gains = scene("ring", 900).image, detectors.gains["ring"]
    saliency = saliency_map(image, gains, **asdict(thesis().saliency))
    y, x = np.unravel_index(saliency.argmax(), saliency.shape)
    ((at_x, at_y),) = places(Retina(image), gains, thesis())
    assert (at_x, at_y) == ((x + 0.5) * 4 - 0.5, (y + 0.5) * 4 - 0.5)
    window = Retina(image).window((at_x, at_y), 50)
    features = c2(window[None], fixed_dictionary())
    look = plain.look("ring", Retina(image))
    assert look.score == pytest.approx(float(plain.machines.scores(features)[0, 1]), abs=1e-4)


def test_calibration_sets_the_thresholds_that_err_least(detectors: Detectors) -> None:
    scenes = [(name, scene(name, 1000 + i).image) for i in range(3) for name in ("cross", "ring", None)]
    present = np.array([[name == each for each in detectors.names] for name, _ in scenes])
    images = [image for _, image in scenes]
    shifted = replace(detectors, machines=detectors.machines.raised(np.array([50.0, -50.0])))
    errors = [(np.array([d.scores(i) > 0 for i in images]) != present).mean() for d in (detectors, shifted)]
    fixed = shifted.calibrated(images, present)
    assert (np.array([fixed.scores(image) > 0 for image in images]) != present).mean() <= min(errors)


def test_mistakes_are_said_in_one_line(detectors: Detectors) -> None:
    with pytest.raises(ValueError, match="nobody can detect 'sofa': expected one of cross, ring"):
        detectors.present("sofa", Retina(scene("ring", 0).image))
    with pytest.raises(ValueError, match="expected two or more, not ring"):
        Detectors.train({"ring": [scene("ring", 0)]}, rng=np.random.default_rng(0))
    with pytest.raises(ValueError, match="no tagged images of 'ring'"):
        Detectors.train({"cross": [scene("cross", 0)], "ring": []}, rng=np.random.default_rng(0))
    with pytest.raises(ValueError, match="gains are of a"):
        tagged = {"cross": [scene("cross", 0)], "ring": [scene("ring", 0)]}
        Detectors.train(tagged, rng=np.random.default_rng(0), gains={"a": Gains()})
    with pytest.raises(ValueError, match="expected a row for each of 1 images"):
        detectors.calibrated([scene("ring", 0).image], np.zeros((1, 3)))
    with pytest.raises(ValueError, match="fixations is 0"):
        DetectorSettings(fixations=0)
    with pytest.raises(ValueError, match="fixed dictionary is of grey C1"):
        DetectorSettings(prototypes=0)


def test_nothing_salient_is_no_object(detectors: Detectors) -> None:
    look = detectors.look("ring", Retina(np.full((HEIGHT, WIDTH, 3), 120, np.uint8)))
    assert look.place is None and look.score == -np.inf


# -------------------------------------------------------------------- machines


def test_machines_tell_classes_apart_whatever_the_scale_of_features() -> None:
    rng = np.random.default_rng(0)
    scale = 10.0 ** rng.uniform(-4, 4, 6)
    classes = [(rng.normal(size=(40, 6)) + 3 * np.eye(6)[k]) * scale for k in range(3)]
    sets = [(classes[k], np.concatenate([c for j, c in enumerate(classes) if j != k])) for k in range(3)]
    machines = train_machines(sets, penalty=10)
    right = [(machines.scores(features).argmax(axis=1) == k).mean() for k, features in enumerate(classes)]
    assert min(right) > 0.85


def test_constant_features_say_nothing() -> None:
    rng = np.random.default_rng(0)
    ones = np.ones((10, 1))
    members, others = (np.hstack([rng.normal(m, 1, (10, 2)), ones]) for m in (2, -2))
    machines = train_machines([(members, others)])
    assert machines.weights[0, 2] == 0
    with pytest.raises(ValueError, match="class 0 has 0 members"):
        train_machines([(members[:0], others)])
    with pytest.raises(ValueError, match="must be finite"):
        LinearMachines(np.array([[np.nan]]), np.zeros(1))


@settings(max_examples=50)
@given(st.lists(st.tuples(st.integers(-5, 5), st.booleans()), min_size=1, max_size=20))
def test_the_threshold_makes_the_fewest_mistakes(examples: list[tuple[int, bool]]) -> None:
    scores, present = np.array([s for s, _ in examples], float), np.array([p for _, p in examples])
    if present.all() or not present.any():
        assert best_threshold(scores, present) == 0
        return
    candidates = np.arange(-6.5, 6.5, 0.5) + 0.25
    fewest = min(((scores > t) != present).sum() for t in candidates)
    assert ((scores > best_threshold(scores, present)) != present).sum() == fewest


# -------------------------------------------------------------------- what becomes of questions


def test_shares_count_what_was_looked_at_and_what_was_answered() -> None:
    def asked(present: bool, on: list[bool], scores: list[float]) -> Asked:
        return Asked("ring", present, np.array(on, bool), np.array(scores))

    found = [
        asked(True, [False, True], [-1, 1]),  # found at the second look
        asked(True, [True, False], [-1, -1]),  # looked at, not known
        asked(False, [False, False], [-1, 1]),  # taken for it at the second look
        asked(False, [], []),  # nothing salient
    ]
    both, one = shares(found), shares(found, 1)
    assert both == {
        "first": 0.5,
        "found": 1.0,
        "recognised": 0.5,
        "misses": 0.5,
        "alarms": 0.5,
        "errors": 0.5,
        "windows": 1.5,
    }
    assert (one["found"], one["misses"], one["alarms"], one["windows"]) == (0.5, 1, 0, 0.75)
    assert np.isnan(shares([])["errors"])


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (["--objects", "sofa"], "--objects has 'sofa'; expected drawn, or some of pedestrian"),
        (["--objects", "bike"], "expected two or more, not bike"),
        (["--images", "0"], "--images is 0"),
        (["--fixations", "0"], "fixations is 0"),
    ],
)
def test_the_command_says_mistakes_in_one_line(
    arguments: list[str], says: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    status = cli.main(command, "runs.detectors", ["--out", str(tmp_path / "d.zip"), *arguments])
    told = capsys.readouterr().err.strip()
    assert status == 2 and says in told and "\n" not in told
