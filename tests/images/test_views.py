"""Photographs with poses: files, cameras, smaller images, and what is said when a file is wrong."""

from __future__ import annotations

import dataclasses
import json

import mitsuba as mi
import numpy as np
import pytest

from mi_enhance.evaluation import scenes
from mi_enhance.images.cameras import around, render_views
from mi_enhance.images.view_files import FILE, read_views, write_views
from mi_enhance.images.views import View


@pytest.fixture
def photos(llvm):
    """Two views of random pixels, one masked and held out."""
    rng = np.random.default_rng(0)
    first, second = around(2, target=(0, 1, 0), distance=5, resolution=8)
    mask = np.arange(64).reshape(8, 8) % 3 > 0
    return [
        dataclasses.replace(first, image=rng.random((8, 8, 3), np.float32) * 4),
        dataclasses.replace(second, image=rng.random((8, 8, 3), np.float32), mask=mask, split="test"),
    ]


def edited(folder, change):
    """Read after a change of the JSON."""
    content = json.loads((folder / FILE).read_text())
    change(content)
    (folder / FILE).write_text(json.dumps(content))
    return read_views(folder)


def test_what_is_written_is_read(photos, tmp_path):
    file = write_views(photos, tmp_path / "deep" / "folder")
    for source in (file, file.parent):
        for a, b in zip(photos, read_views(source), strict=True):
            np.testing.assert_array_equal(a.image, b.image)
            np.testing.assert_array_equal(a.mask, b.mask)
            np.testing.assert_allclose(a.to_world, b.to_world, atol=1e-12)
            assert (a.name, a.split, b.ceiling) == (b.name, b.split, np.inf)
            assert b.fov == pytest.approx(a.fov) and b.principal_point == pytest.approx(a.principal_point)


def test_8_bit_images_are_srgb_and_say_where_they_are_saturated(photos, tmp_path):
    write_views(photos, tmp_path, suffix=".png")
    view = read_views(tmp_path)[0]
    truth = np.clip(photos[0].image, 0, 1)
    # half a step of 1/255 of the curve, whose slope is at most 2.4 in linear values
    np.testing.assert_allclose(view.image, truth, atol=2.4 * 0.5 / 255)
    assert (view.saturated == (view.image == 1)).all() and 0.5 < view.saturated.mean() < 1


def test_focal_length_and_principal_point(photos, tmp_path):
    write_views(photos, tmp_path)

    def change(content):
        del content["frames"][0]["camera_angle_x"]
        content.update(fl_x=12.0, fl_y=12.0)
        content["frames"][0].update(cx=3.0, cy=4.0)

    view = edited(tmp_path, change)[0]
    assert np.tan(np.radians(view.fov / 2)) == pytest.approx(4 / 12)
    assert view.principal_point == (3 / 8, 1 / 2)


def test_camera_follows_the_opengl_convention(llvm):
    """A sphere at the right of and above what the camera looks at is at the right of and above the picture's middle."""
    back = np.array([0.6, 0.0, 0.8])
    right, up = np.array([0.8, 0.0, -0.6]), np.array([0.0, 1.0, 0.0])
    to_world = np.eye(4)
    to_world[:3] = np.stack((right, up, back, 5 * back), 1)
    ball = {"type": "sphere", "center": list(0.5 * right + 0.25 * up), "radius": 0.1}
    lit = mi.load_dict({"type": "scene", "ball": {**ball, "emitter": {"type": "area", "radiance": 1.0}}})
    black = np.zeros((32, 32, 3), np.float32)
    for center in ((0.5, 0.5), (0.25, 0.6)):
        view = View("v", black, to_world, 30.0, principal_point=center)
        image = render_views(lit, [view], spp=4)[0].image[..., 0]
        row, column = (np.average(n, weights=image) + 0.5 for n in np.indices(image.shape))
        focal = 16 / np.tan(np.radians(15))
        # a pixel: the sphere is a disk of 2 pixels, seen from the side
        assert column == pytest.approx(32 * center[0] + focal * 0.5 / 5, abs=1)
        assert row == pytest.approx(32 * center[1] - focal * 0.25 / 5, abs=1)


def test_smaller_view_sees_the_same(llvm):
    """A camera with a third of the pixels, two columns cut off, renders the means of the large one's blocks."""
    ball = scenes.load("sphere_envmap", {"type": "diffuse"}, resolution=16, spp=1)
    (view,) = around(1, target=(0.3, 1, 0), distance=5, resolution=32)
    (large,) = render_views(ball, [view], spp=256)
    small = large.smaller(3)
    assert small.size == (10, 10)
    (again,) = render_views(ball, [small], spp=1024)
    # noise of 1,000 paths from a sky with a bright window; a shift by half a pixel would give 0.1 at the silhouette
    assert np.abs(again.image - small.image).mean() < 0.03


def test_smaller_view_keeps_what_is_known_of_a_block():
    image = np.full((4, 4, 3), 0.5, np.float32)
    image[:2, :2] = 1.0  # one block saturated as a whole, one in part
    image[2, 2] = 1.0
    mask = np.ones((4, 4), bool)
    mask[0, 3] = False
    small = View("v", image, np.eye(4), 30.0, mask, ceiling=1.0).smaller(2)
    assert small.mask.tolist() == [[True, False], [True, False]]
    assert small.saturated[..., 0].tolist() == [[True, False], [False, False]]


WRONG = {
    "frames must be a list of at least one": lambda c: c.update(frames=[]),
    "must be an object with file_path": lambda c: c["frames"][0].pop("file_path"),
    "there is no image": lambda c: c["frames"][0].update(file_path="gone.exr"),
    "w says 9": lambda c: c["frames"][0].update(w=9),
    "is not a rotation": lambda c: c["frames"][0]["transform_matrix"][0].__setitem__(0, 3.0),
    "4 x 4 numbers": lambda c: c["frames"][0].update(transform_matrix=[[1, 0], [0, "x"]]),
    "neither camera_angle_x": lambda c: c["frames"][0].pop("camera_angle_x"),
    "it is in radians": lambda c: c["frames"][0].update(camera_angle_x=40),
    "lens distortion": lambda c: c.update(k1=0.1),
    'split "half" is unknown': lambda c: c["frames"][0].update(split="half"),
    "the name of two frames": lambda c: c["frames"][1].update(file_path="view_00.exr"),
    "camera_angle_x must be a number": lambda c: c["frames"][0].update(camera_angle_x="wide"),
    "Give it the same size": lambda c: c["frames"][0].update(mask_path="small.png"),
    "no pixel counts in any": lambda c: [f.update(mask_path="black.png") for f in c["frames"]],
}


@pytest.mark.parametrize("message", WRONG)
def test_wrong_files_are_refused(photos, tmp_path, message):
    write_views(photos, tmp_path)
    for name, size in (("small.png", 4), ("black.png", 8)):
        mi.Bitmap(np.zeros((size, size, 3), np.uint8)).write(str(tmp_path / name))
    with pytest.raises((ValueError, FileNotFoundError), match=message):
        edited(tmp_path, WRONG[message])


def test_no_json_no_file_no_image_and_nan_are_refused(photos, tmp_path):
    with pytest.raises(FileNotFoundError, match="no such file"):
        read_views(tmp_path)
    (tmp_path / FILE).write_text("{")
    with pytest.raises(ValueError, match="is no JSON"):
        read_views(tmp_path)
    (tmp_path / FILE).unlink()
    write_views(photos, tmp_path)
    (tmp_path / "view_00.exr").write_bytes(b"no image")
    with pytest.raises(ValueError, match="cannot be read as an image"):
        read_views(tmp_path)
    image = photos[0].image.copy()
    image[1, 1] = np.nan
    write_views([dataclasses.replace(photos[0], image=image)], tmp_path / "nan")
    with pytest.raises(ValueError, match="3 values that are NaN.*mask_path"):
        read_views(tmp_path / "nan")
    with pytest.raises(ValueError, match="suffix"):
        write_views(photos, tmp_path, suffix=".jpg")


def test_views_take_arrays_of_other_types(tmp_path, llvm):
    """A mask of integers is no list of indices, and NaN that counts is not hidden by it."""
    image = np.full((4, 6, 3), 0.5)
    image[0, 0] = np.nan
    numbers = {"ceiling": np.float32(0.75), "principal_point": np.full(2, 0.5, np.float32)}
    view = View("a", image, np.eye(4).tolist(), np.float32(40), np.full((4, 6), 255, np.uint8), **numbers)
    assert view.image.dtype == np.float32 and view.mask.dtype == bool and view.mask.all()
    assert np.isnan(view.image[0, 0]).all() and view.image[view.mask].shape == (24, 3)
    with pytest.raises(ValueError, match="holds NaN"):
        write_views([view], tmp_path, suffix=".png")
    masked = np.ones((4, 6))
    masked[0, 0] = 0
    (again,) = read_views(write_views([dataclasses.replace(view, mask=masked)], tmp_path))
    assert again.mask.sum() == 23 and again.ceiling == 0.75


@pytest.mark.parametrize(
    "change", [{"image": np.zeros((4, 6))}, {"image": np.zeros((4, 6, 4))}, {"mask": np.ones((6, 4), bool)},
               {"split": "val"}, {"to_world": np.eye(3)}],
)  # fmt: skip
def test_views_of_other_shapes_are_refused(change):
    with pytest.raises(ValueError, match='view "a": .* needed: '):
        dataclasses.replace(View("a", np.zeros((4, 6, 3), np.float32), np.eye(4), 40.0), **change)
