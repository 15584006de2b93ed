"""The meter tells the truth: what is read is what is counted, for arrays and tensors alike."""

from __future__ import annotations

import numpy as np
import pytest
import torch
from hypothesis import given
from hypothesis import strategies as st

from attn_tree.vision.retina import Retina, meter, metering
from attn_tree.vision.tensor_retina import TensorRetina


def _image(height: int = 48, width: int = 64) -> np.ndarray:
    return np.random.default_rng(0).integers(0, 256, (height, width, 3), dtype=np.uint8)


@given(x=st.floats(-50, 150), y=st.floats(-50, 150), size=st.integers(1, 80), stride=st.integers(1, 4))
def test_window_counts_what_it_returns_and_stays_inside(x: float, y: float, size: int, stride: int) -> None:
    retina = Retina(_image())
    patch = retina.window((x, y), size, stride=stride)
    (reading,) = retina.ledger.readings
    assert reading.values == patch.shape[0] * patch.shape[1]
    assert 0 <= reading.left < reading.right <= 64
    assert 0 <= reading.top < reading.bottom <= 48
    assert (reading.right - reading.left, reading.bottom - reading.top) == (min(size, 64), min(size, 48))


def test_touched_counts_overlap_once() -> None:
    with meter() as cost:
        retina = Retina(_image())
        retina.window((20, 20), 10)
        retina.window((25, 20), 10)
    assert cost.recognition == 200
    assert cost.touched == 150
    assert cost.fraction == 200 / (64 * 48)


def test_a_glance_takes_in_little_and_touches_all() -> None:
    with meter() as cost:
        assert Retina(_image()).glance(16).shape == (16, 16, 3)
    assert (cost.selection, cost.recognition, cost.touched) == (256, 0, 64 * 48)


def test_array_and_tensor_windows_agree_in_pixels_and_in_the_ledger() -> None:
    image = _image()
    tensor = torch.from_numpy(image).permute(2, 0, 1)[None].double()
    size, left, top = 10, 7, 21
    # The place whose window has its corner exactly at (left, top).
    place = torch.tensor([[left / (64 - size) * 2 - 1, top / (48 - size) * 2 - 1]], dtype=torch.float64)
    with meter() as cost_tensor:
        seen = TensorRetina(tensor).window(place, size)
    with meter() as cost_array:
        patch = Retina(image).window((left + size / 2, top + size / 2), size)
    assert torch.allclose(seen[0].permute(1, 2, 0), torch.from_numpy(patch).double(), atol=1e-6)
    assert cost_tensor.recognition == cost_array.recognition == size * size
    assert abs(cost_tensor.touched - cost_array.touched) <= 2 * size + 1  # rounding of the place


def test_places_at_the_rim_stay_inside_and_have_a_gradient() -> None:
    images = torch.from_numpy(_image()).permute(2, 0, 1)[None].float()
    place = torch.tensor([[1.0, -1.0]], requires_grad=True)
    seen = TensorRetina(images).window(place, 8)
    assert torch.allclose(seen[0], images[0, :, :8, -8:], atol=1e-3)
    inner = torch.tensor([[0.3, -0.2]], requires_grad=True)
    TensorRetina(images).window(inner, 8).square().sum().backward()
    assert inner.grad is not None and inner.grad.abs().sum() > 0


def test_meters_nest_and_end() -> None:
    assert not metering()
    with meter() as outer:
        Retina(_image()).whole()
        with meter() as inner:
            Retina(_image()).glance(4)
    assert not metering()
    assert (outer.processed, inner.processed) == (64 * 48, 16)


@given(
    columns=st.lists(st.integers(0, 64), min_size=2, max_size=2, unique=True),
    rows=st.lists(st.integers(0, 48), min_size=2, max_size=2, unique=True),
    looks=st.lists(
        st.tuples(st.integers(-10, 70), st.integers(-10, 60), st.integers(1, 60)), min_size=1, max_size=4
    ),
    nested=st.booleans(),
)
def test_a_region_reads_as_the_cropped_image_does_and_enters_native_pixels(
    columns: list[int], rows: list[int], looks: list[tuple[int, int, int]], nested: bool
) -> None:
    """Every pixel carries its own coordinates, so what was seen says what was touched."""
    (left, right), (top, bottom) = sorted(columns), sorted(rows)
    image = np.dstack([*np.indices((48, 64)), np.zeros((48, 64))]).astype(np.uint8)
    crop, seen = image[top:bottom, left:right], []
    with meter() as cost:
        part = retina = Retina(image)
        if nested:
            part = part.region(left, 0, 64, bottom).region(0, top, right - left, bottom)
        else:
            part = part.region(left, top, right, bottom)
    assert not cost.processed
    other = Retina(crop)
    for x, y, size in looks:
        seen.append(part.window((x, y), size))
        np.testing.assert_array_equal(seen[-1], other.window((x, y), size))
    assert cost.recognition == sum(patch[..., 0].size for patch in seen)
    assert cost.touched == len({tuple(pixel) for patch in seen for pixel in patch.reshape(-1, 3).tolist()})
    np.testing.assert_array_equal(part.glance(5), other.glance(5))
    np.testing.assert_array_equal(part.whole("selection"), crop)
    assert (cost.selection, cost.touched) == (25 + crop[..., 0].size, crop[..., 0].size)
    assert len(cost.ledgers) == 1 and cost.fraction == cost.processed / (64 * 48)
    part.count(macs=3)
    assert retina.ledger.operations["macs"] == 3


@pytest.mark.parametrize(
    "bounds", [(5, 5, 5, 9), (9, 5, 5, 9), (-1, 0, 5, 5), (0, 0, 65, 5), (0, 40, 5, 49), (0, 0, 4.5, 5)]
)
def test_a_region_that_is_empty_or_outside_is_refused_in_one_line(bounds: tuple[int, int, int, int]) -> None:
    with pytest.raises(ValueError, match="a region of an image of 64 × 48") as error:
        Retina(_image()).region(*bounds)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    "bad", [np.zeros((4, 4)), np.zeros((0, 4, 3), np.uint8), np.zeros((4, 4, 4), np.uint8)]
)
def test_what_is_no_image_is_refused_in_one_line(bad: np.ndarray) -> None:
    with pytest.raises(ValueError, match="an image must be uint8") as error:
        Retina(bad)
    assert "\n" not in str(error.value)
