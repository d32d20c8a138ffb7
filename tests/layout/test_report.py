import dataclasses
import re

import numpy as np
import pytest

from occjax.cli.measuring import format_report
from occjax.data.bundled_sample import sample
from occjax.errors import InputError
from occjax.io import (
    ViewOrderWarning,
    join_macpi,
    join_tiles,
    load,
    read_pfm,
    split_macpi,
    split_tiles,
)
from occjax.layout import (
    ORIENTATIONS,
    Orientation,
    ViewOrderConfig,
    check,
    disparity_range_of,
    straightened,
)
from occjax.lightfield import LightField, view_offsets
from tests.io.scenes import texture, two_planes
from tests.scenes import plane

DECLARED = Orientation()


@pytest.fixture(scope="module")
def scene():
    return LightField(two_planes()[0], name="two planes")


@pytest.fixture(scope="module")
def report(scene):
    return check(scene)


@pytest.mark.parametrize("stored", ORIENTATIONS, ids=lambda orientation: orientation.name)
def test_each_of_the_eight_view_orders_is_recognised(scene, stored):
    report = check(stored.apply(scene))
    assert stored.then(report.best) == DECLARED
    assert report.clearly_worse == (stored != DECLARED)
    assert report.conclusive
    assert report.sign_known
    assert report.nearer_in_front > 0.9
    assert set(report.scores) == {orientation.name for orientation in ORIENTATIONS}
    assert report.scores[report.best.name] == min(report.scores.values())


def test_the_range_encloses_the_scene_with_a_small_margin(report):
    low, high = report.disparity_range
    assert -1.0 - 0.5 <= low < -1.0
    assert 1.5 < high <= 1.5 + 0.5


@pytest.mark.parametrize(("contrast", "noise"), [(1.0, 0.03), (0.1, 0.008)])
def test_weak_texture_and_noise_do_not_narrow_the_range(scene, contrast, noise):
    rng = np.random.default_rng(0)
    weak = 0.5 + contrast * (scene.views - 0.5) + rng.normal(0, noise, scene.views.shape)
    low, high = check(LightField(np.clip(weak, 0, 1).astype(np.float32))).disparity_range
    assert -1.0 - 1.5 <= low < -1.0
    assert 1.5 < high <= 1.5 + 1.5


@pytest.mark.parametrize("gain", [1 / 16, 1 / 200])
def test_nothing_depends_on_the_exposure(scene, report, gain):
    """Sensors of 12 bits stored in 16 use a sixteenth of the type."""
    dark = check(LightField(np.rint(scene.views * gain * 65535).astype(np.uint16)))
    assert dark.best == DECLARED
    assert dark.conclusive
    assert dark.sign_known == report.sign_known
    np.testing.assert_allclose(dark.disparity_range, report.disparity_range, atol=0.15)
    for name, score in report.scores.items():
        np.testing.assert_allclose(dark.scores[name], gain * score, rtol=0.2)


@pytest.mark.parametrize("grid", [(3, 3), (2, 2), (3, 5), (4, 4)])
def test_small_and_uneven_grids_are_measured(grid):
    """Flipping an even grid makes another view the centre, so there the orders that keep it."""
    scene = LightField(two_planes(grid)[0])
    report = check(scene)
    assert not report.clearly_worse
    low, high = report.disparity_range
    assert low < -1.0 < 1.5 < high
    swapped = check(Orientation(swap=True).apply(scene))
    assert swapped.clearly_worse
    assert swapped.best == Orientation(swap=True)


@pytest.mark.parametrize("grid", [(1, 5), (5, 1), (1, 2)])
def test_one_row_or_column_of_views_is_measured(grid):
    scene = LightField(two_planes(grid)[0])
    report = check(scene)
    assert not report.clearly_worse
    assert report.best == DECLARED
    low, high = report.disparity_range
    assert low < -1.0 < 1.5 < high
    assert check(Orientation(swap=True).apply(scene)).best == Orientation(swap=True)


def test_occlusion_shows_that_a_row_of_views_is_reversed():
    scene = LightField(two_planes((1, 5))[0])
    report = check(LightField(np.ascontiguousarray(scene.views[:, ::-1])))
    assert report.clearly_worse
    assert report.best.flip_columns


def test_without_occlusion_the_sign_stays_as_declared():
    """A slanted wall hides nothing: both signs are equally consistent."""
    y = x = np.arange(96.0)
    offsets = range(-2, 3)
    views = np.stack([[texture(y + 1.3 * v, x + 1.3 * u) for u in offsets] for v in offsets])
    for stored in (DECLARED, DECLARED.reversed_sign):
        report = check(stored.apply(LightField(views.astype(np.float32))))
        assert report.best == DECLARED
        assert not report.clearly_worse
        assert not report.sign_known
        low, high = report.disparity_range
        true = 1.3 if stored == DECLARED else -1.3
        assert low < true < high


@pytest.mark.parametrize("value", [0, 255])
def test_views_without_texture_are_not_called_wrong(value):
    report = check(LightField(np.full((5, 5, 40, 48, 3), value, np.uint8)))
    assert report.best == DECLARED
    assert not report.clearly_worse
    assert report.measured_fraction == 0.0
    assert not report.conclusive
    assert report.plausible


@pytest.mark.parametrize("size", [32, 64])
def test_pure_noise_is_not_called_wrong_but_implausible(size):
    noise = np.random.default_rng(0).integers(0, 256, (5, 5, size, size, 1), np.uint8)
    report = check(LightField(noise))
    assert not report.clearly_worse
    assert not report.conclusive
    assert not report.plausible
    assert report.disparity_range == (-4.0, 4.0)
    assert report.measured_fraction == 0.0


def test_copies_of_one_view_are_plausible_in_every_view_order(scene):
    same = np.broadcast_to(scene.centre, scene.views.shape)
    report = check(LightField(np.ascontiguousarray(same)))
    assert report.plausible
    assert not report.conclusive
    assert not report.clearly_worse


@pytest.mark.parametrize(("join", "split"), [(join_tiles, split_macpi), (join_macpi, split_tiles)])
def test_a_mosaic_taken_apart_wrongly_is_not_conclusive(join, split):
    views = two_planes((5, 5), (60, 60))[0]
    report = check(LightField(split(join(views), (5, 5))))
    assert not report.conclusive
    assert not report.clearly_worse
    if join is join_macpi:  # In the other case the views are small, similar and hardly move.
        assert not report.plausible


def test_vignetting_and_noise_do_not_matter(scene):
    rng = np.random.default_rng(0)
    v, u, y, x = np.ogrid[-2:3, -2:3, -1:1:64j, -1:1:64j]
    shade = 1 - 0.05 * ((v / 2 + y) ** 2 + (u / 2 + x) ** 2)
    views = scene.views * shade[..., None] + rng.normal(0, 0.02, scene.views.shape)
    worn = LightField(np.clip(views, 0, 1).astype(np.float32))
    for stored in (DECLARED, Orientation(flip_columns=True, swap=True)):
        assert stored.then(check(stored.apply(worn)).best) == DECLARED


def test_positions_replace_the_regular_grid(scene):
    """Cameras twice as far apart as the grid says halve the disparity."""
    offsets = np.stack(np.mgrid[-2:3, -2:3], axis=-1).astype(np.float32)
    report = check(LightField(scene.views, positions=2 * offsets))
    assert -0.5 - 0.25 <= report.disparity_range[0] < -0.5
    assert 0.75 < report.disparity_range[1] <= 0.75 + 0.25


def test_one_view_is_refused():
    with pytest.raises(InputError, match="one view"):
        check(LightField(np.zeros((1, 1, 8, 8, 1), np.uint8)))


@pytest.mark.usefixtures("unchecked")
def test_an_array_is_refused(scene):
    with pytest.raises(InputError, match=r"not ndarray; pass LightField\(views\)"):
        check(scene.views)


def test_positions_that_are_all_the_same_are_refused(scene):
    with pytest.raises(InputError, match="camera positions are the same"):
        check(LightField(scene.views, positions=np.zeros((5, 5, 2), np.float32)))


@pytest.mark.slow
def test_a_real_light_field_is_recognised_rotated(shared):
    """The synthetic scene has all eight orders."""
    light_field = load(shared / "data/lytro/2067", check_orientation=False)
    stored = Orientation(flip_rows=True, swap=True)
    report = check(stored.apply(light_field))
    assert stored.then(report.best) == DECLARED
    assert report.clearly_worse


@pytest.mark.slow
@pytest.mark.parametrize("scene", ["hci/antinous", "rendered/s013", "lytro/2067"])
def test_real_light_fields_are_as_declared_and_the_range_encloses_the_truth(shared, scene):
    light_field = load(shared / "data" / scene, check_orientation=False)
    report = check(light_field)
    assert report.best == DECLARED
    assert not report.clearly_worse
    if scene != "lytro/2067":
        truth, (low, high) = light_field.ground_truth, report.disparity_range
        assert truth.min() - 0.5 < low < np.percentile(truth, 0.5)
        assert np.percentile(truth, 99.5) < high < truth.max() + 0.5


@pytest.mark.slow
@pytest.mark.parametrize(
    ("scene", "crop"),
    [
        ("hci/antinous", np.s_[2:7, 2:7]),
        ("lytro/2067", np.s_[3:6, 3:6]),
        ("rendered/s013", np.s_[::4, ::4]),
        ("hci/antinous", np.s_[4:5, 3:6]),
        ("lytro/2067", np.s_[4:5, 3:6]),
    ],
)
def test_small_crops_of_real_grids_are_called_wrong_only_if_swapped(shared, scene, crop):
    light_field = load(shared / "data" / scene, check_orientation=False)
    small = LightField(np.ascontiguousarray(light_field.views[crop]))
    assert not check(small).clearly_worse
    report = check(Orientation(swap=True).apply(small))
    assert report.clearly_worse
    assert report.best.swap


@pytest.mark.slow
@pytest.mark.parametrize(
    ("scene", "row", "column"),
    [
        ("hci/antinous", 372, 280),
        ("hci/antinous", 200, 220),
        ("hci/antinous", 294, 36),
        ("rendered/s013", 76, 64),
        ("rendered/s013", 72, 47),
    ],
)
def test_the_range_of_crops_encloses_the_truth_in_spite_of_noise(shared, scene, row, column):
    crop = np.s_[row : row + 128, column : column + 128]
    views = load(shared / "data" / scene, check_orientation=False).views[:, :, *crop] / 255
    truth = read_pfm(shared / "data" / scene / "gt_disp_lowres.pfm")[crop]
    noisy = views + np.random.default_rng(0).normal(0, 4 / 255, views.shape)
    low, high = check(LightField(np.clip(noisy, 0, 1).astype(np.float32))).disparity_range
    assert np.mean((truth < low) | (truth > high)) < 0.01


@pytest.mark.parametrize("grid", [(3, 3), (9, 9)])
def test_repeated_texture_and_few_views_do_not_widen_the_range(grid):
    """The wood grain of the sample repeats after six pixels."""
    light_field = sample().central(*grid)
    truth = sample().ground_truth
    low, high = check(light_field).disparity_range
    assert truth.min() - 1.0 < low < truth.min()
    assert truth.max() < high < truth.max() + 1.0


def test_a_tiny_crop_raises_no_false_alarm(shared):
    views = load(shared / "data/rendered/s013", check_orientation=False).views
    for row, column in np.random.default_rng(0).integers(0, 140, (6, 2)):
        crop = views[:, :, row : row + 32, column : column + 32]
        assert not check(LightField(np.ascontiguousarray(crop))).clearly_worse


def test_an_inconclusive_report_keeps_the_declared_sign(shared):
    """Disparity edges that are too wide vote for the wrong sign here."""
    views = load(shared / "data/rendered/s013", check_orientation=False).views
    truth = read_pfm(shared / "data/rendered/s013/gt_disp_lowres.pfm")[180:244, 156:220]
    report = check(LightField(np.ascontiguousarray(views[:, :, 180:244, 156:220])))
    assert not report.conclusive
    assert report.best == DECLARED
    low, high = report.disparity_range
    assert low < np.percentile(truth, 1) < np.percentile(truth, 99) < high


def test_the_declared_range_is_that_of_the_light_field_as_it_is(scene):
    """Occlusion shows a grid turned by 180 degrees, but the views are used as declared."""
    turned = DECLARED.reversed_sign.apply(scene)  # disparities of 1 and -1.5
    report = check(turned)
    assert report.best == DECLARED.reversed_sign
    low, high = report.declared_range
    assert -2.0 <= low < -1.5
    assert 1.0 < high <= 1.5
    assert report.disparity_range == (-high, -low)
    assert disparity_range_of(turned)[0] == (low, high)


def test_the_range_is_declared_or_measured_and_explained(scene):
    assert disparity_range_of(dataclasses.replace(scene, disparity_range=(-3.0, 3.0))) == (
        (-3.0, 3.0),
        (),
    )
    (low, high), (note,) = disparity_range_of(scene)
    assert f"[{low:.2f}, {high:.2f}] found by photo-consistency" in note
    (low, high), (note,) = disparity_range_of(LightField(np.zeros((3, 3, 16, 16, 1), np.uint8)))
    assert (low, high) == (-4.0, 4.0)
    assert "too little texture" in note


def test_disparities_beyond_the_search_say_which_option_extends_it(tmp_path):
    """A wall of 45 pixels per view step, in views of 96 pixels, of which 38 are searched."""
    far = plane((3, 3), (96, 96), disparity=45.0)
    assert "pass max_disparity (--max-disparity)" in disparity_range_of(far)[1][0]
    np.save(tmp_path / "far.npy", far.views)
    with pytest.warns(ViewOrderWarning, match=r"pass max_disparity \(--max-disparity\)"):
        load(tmp_path / "far.npy")
    assert "pass a larger --max-disparity" in format_report(check(far), DECLARED)


def test_a_report_is_measured_once_and_belongs_to_its_views(tmp_path, scene):
    np.save(tmp_path / "scene.npy", scene.views)
    loaded = load(tmp_path / "scene.npy")
    assert loaded.view_order_report is not None
    assert check(loaded) is loaded.view_order_report
    assert check(loaded, ViewOrderConfig(fine_size_px=48)) is not loaded.view_order_report
    assert loaded.central(3, 3).view_order_report is None
    assert Orientation(swap=True).apply(loaded).view_order_report is None
    assert load(tmp_path / "scene.npy", check_orientation=False).view_order_report is None


def test_disparities_beyond_the_first_search_are_found():
    """The first search in views of 120 pixels ends at 9.6 pixels per view step."""
    views, _ = two_planes((3, 3), (120, 140), far=3.0, near=18.0)
    report = check(LightField(views))
    low, high = report.disparity_range
    assert low <= 3.0
    assert 18.0 <= high < 25.0
    assert report.max_disparity == pytest.approx(48.0, abs=2.0)


def test_a_search_that_ends_before_the_scene_says_so():
    views, _ = two_planes((3, 3), (120, 140), far=7.0, near=18.0)
    report = check(LightField(views), ViewOrderConfig(max_disparity_px=7.0))
    light_field = LightField(views, view_order_report=report)
    _, (note,) = disparity_range_of(light_field)
    assert "where the search ended" in note
    assert "--max-disparity" in note


@pytest.mark.parametrize("grid", [(3, 3), (5, 5), (4, 4)])
def test_serpentine_order_is_proposed(grid):
    """The centre row of three is reversed too, that of five is not."""
    report = check(LightField(straightened(two_planes(grid, far=-0.6, near=0.8)[0])))
    assert report.disorder == "serpentine"
    assert "pass order (--order serpentine)" in report.position_notes[0]
    assert "pass order (--order serpentine)" in format_report(report, DECLARED)


@pytest.mark.parametrize(
    ("other", "size"), [((2, 3), 64), pytest.param((0, 0), 96, marks=pytest.mark.slow)]
)
def test_a_swapped_centre_view_is_the_misplaced_one(report, other, size):
    in_place, _ = two_planes(size=(size, size))
    views = in_place.copy()
    views[2, 2], views[other] = in_place[other], in_place[2, 2]
    found = check(LightField(views))
    assert found.disorder == "centre"
    assert found.position_notes[0].startswith("the centre view (2, 2) is not in its place")
    assert found.registration is not None
    moved = {tuple(index) for index in np.argwhere(found.registration.moved).tolist()}
    assert (2, 2) in moved <= {(2, 2), other}
    regular = view_offsets(5, 5)
    expected = regular - regular[other]
    at_place = ~found.registration.moved
    np.testing.assert_allclose(found.registration.positions[at_place], expected[at_place], atol=0.1)
    assert found.disparity_range == pytest.approx(report.disparity_range, abs=0.3)


def test_the_neighbours_of_the_centre_view_may_be_exchanged(scene):
    """The cross around the centre view is as inconsistent as if that view was misplaced."""
    views = scene.views.copy()
    views[1, 2], views[3, 2] = scene.views[3, 2], scene.views[1, 2]
    report = check(LightField(views))
    assert report.disorder is None
    assert report.registration is not None
    assert np.argwhere(report.registration.moved).tolist() == [[1, 2], [3, 2]]
    found = report.registration.positions[[1, 3], 2]
    np.testing.assert_allclose(found, [[1, 0], [-1, 0]], atol=0.1)


@pytest.mark.parametrize("grid", [(6, 4), (3, 8)])
def test_a_wrong_grid_causes_a_warning(tmp_path, grid):
    """Views of a 4x6 grid, read with other numbers of rows and columns."""
    views = two_planes((4, 6))[0]
    path = tmp_path / "views.npy"
    np.save(path, views.reshape(*grid, *views.shape[2:]))
    with pytest.warns(ViewOrderWarning, match="the grid or the order of the views is probably wr"):
        light_field = load(path)
    text = format_report(check(light_field), DECLARED)
    assert re.search(r"view order: \d+ of 24 views are nearer to another place", text)
    assert "view order: as declared" not in text
    assert text.count("pass grid (--grid V U)") == 1


def test_inexact_positions_and_shifts_of_all_views_are_no_wrong_grid():
    generator = np.random.default_rng(1)
    errors, shifts = generator.normal(0.0, 0.3, (2, 5, 5, 2))
    errors[2, 2] = shifts[2, 2] = 0.0
    report = check(LightField(two_planes(positions=view_offsets(5, 5) + errors)[0]))
    assert report.registration.moved.mean() > 0.5
    assert report.disorder is None
    assert check(LightField(two_planes(shifts=5 * shifts)[0])).disorder is None


def test_clean_views_have_no_disorder(report):
    assert report.disorder is None
