"""How well the camera finds items on full shelves, by the pictures of the plant's own camera."""

import math
from dataclasses import dataclass, field

import numpy as np
import pytest
from support.services.perception import TOPS, Item, fill_shelves, open_store

from stepbus_plant.camera import Lens
from stepbus_plant.params import CameraErrors
from stepbus_store.perception.detector import Detection, Detector
from stepbus_store.perception.images import make_view
from stepbus_store.perception.item_catalog import read_catalog

pytestmark = pytest.mark.slow

VIEWS = 40
RIM = {"cola": 0.033, "juice": 0.0425, "water": 0.015, "soup": 0.035}
SURE = 0.5


@dataclass
class Score:
    """What came of all views; errors: kind → rows of horizontal, vertical [mm], yaw [deg]."""

    errors: dict[str, list[tuple[float, float, float]]] = field(default_factory=dict)
    wrong: list[Detection] = field(default_factory=list)
    missing: list[Item] = field(default_factory=list)
    visible: int = 0


def views(store, count, seed=3):
    """Yield images and camera poses 0.2 to 0.35 m above items, tilted by up to 0.2 rad."""
    random = np.random.default_rng(seed)
    for _ in range(count):
        item = store.items[random.integers(len(store.items))]
        offset = [*random.uniform(-0.05, 0.05, 2), TOPS[item.type] + random.uniform(0.2, 0.35)]
        tilt, yaw = random.uniform(-0.2, 0.2, 2), random.uniform(-math.pi, math.pi)
        yield store.look((np.array(item.position) + offset).tolist(), yaw, tilt)


def fully_visible(item, view, camera):
    """Return whether the rim of an item's top is in the image with nothing in front of it."""
    angles = np.linspace(0, 2 * math.pi, 24, endpoint=False)
    rim = np.column_stack([np.cos(angles), np.sin(angles), np.zeros(24)])
    top = np.add(item.position, (0, 0, TOPS[item.type]))
    shape = np.array(view.depth.shape[::-1])
    for scale in (1.0, 0.8):
        local = (top + rim * RIM[item.type] * scale - camera.translation) @ camera.rotation
        pixel = local[:, :2] / local[:, 2:] * view.focal + view.centre
        if (local[:, 2] < 0.05).any() or (pixel < 2).any() or (pixel > shape - 3).any():
            return False
    u, v = np.rint(pixel).astype(int).T
    return bool((np.abs(view.depth[v, u] - local[:, 2]) < 4e-3).all())


def judge(score, store, found):
    for find in found:
        same = [item for item in store.items if item.type == find.type]
        item = min(same, key=lambda item: math.dist(item.position, find.position))
        error = np.subtract(find.position, item.position) * 1e3
        if np.linalg.norm(error) > 30:
            score.wrong.append(find)
        elif find.confidence >= SURE:
            yaw = math.degrees(find.yaw - item.yaw) if item.type == "juice" else 0.0
            row = (float(np.hypot(*error[:2])), float(abs(error[2])), abs(yaw))
            score.errors.setdefault(item.type, []).append(row)


@pytest.fixture(scope="module")
def noisy_score(tmp_path_factory):
    errors = CameraErrors(depth=0.004, color=4.0, blur=0.7, light="lamp")
    return scored(tmp_path_factory, Lens(errors, 3), depth_noise=0.004, at_least=0.2)


def test_noise_blur_and_shadows_hide_nothing(noisy_score):
    assert noisy_score.visible > 60
    assert noisy_score.wrong == noisy_score.missing == []


@pytest.mark.parametrize("kind", list(RIM))
def test_noise_and_blur_cost_two_millimetres(noisy_score, kind):
    horizontal, vertical, _ = np.max(noisy_score.errors[kind], axis=0)
    assert horizontal < 4.0
    assert vertical < 2.0


@pytest.fixture(scope="module")
def score(tmp_path_factory):
    return scored(tmp_path_factory)


def scored(tmp_path_factory, lens=None, depth_noise=0.0, at_least=SURE):
    result = Score()
    with open_store(tmp_path_factory.mktemp("store"), lens=lens) as store:
        fill_shelves(store)
        detector = Detector(read_catalog("poses", store.description), 0.2, depth_noise)
        for images, camera in views(store, VIEWS):
            view = make_view(images)
            found = detector.look(view, camera)[0]
            judge(result, store, found)
            there = [item for item in store.items if fully_visible(item, view, camera)]
            result.visible += len(there)
            result.missing += [item for item in there if not sure(item, found, at_least)]
    return result


def sure(item, found, at_least):
    return any(
        find.type == item.type
        and find.confidence >= at_least
        and math.dist(find.position, item.position) < 0.005
        for find in found
    )


@pytest.mark.parametrize("kind", list(RIM))
def test_an_item_is_placed_within_2_mm_and_1_degree(score, kind):
    errors = np.array(score.errors[kind])
    print(kind, len(errors), "mean", errors.mean(axis=0), "max", errors.max(axis=0))
    assert len(errors) > VIEWS / 2
    assert (errors.max(axis=0) < [2.0, 1.2, 1.0]).all()


def test_nothing_is_taken_for_something_else(score):
    assert score.wrong == []


def test_no_item_is_missed_whose_top_is_in_full_view(score):
    assert score.visible > 3 * VIEWS
    assert score.missing == []
