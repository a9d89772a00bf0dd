"""``transforms.json`` of other programs: what changes the picture is honoured or refused, the rest is known."""

from __future__ import annotations

import dataclasses
import json
import math

import mitsuba as mi
import numpy as np
import pytest
from photograph_damage import poses
from PIL import Image

import mi_enhance  # noqa: F401  (before mitsuba)
from mi_enhance.images.cameras import around, render_views
from mi_enhance.images.view_files import FILE, read_views
from mi_enhance.images.views import View


@pytest.fixture
def read(llvm, tmp_path):
    """Read one photograph of 12 x 8 pixels with some entries in the file."""
    Image.fromarray(np.full((8, 12, 3), 128, np.uint8)).save(tmp_path / "a.png")

    def read(frame=None, **entries):
        content = poses("a.png", **entries)
        content["frames"][0].update(frame or {})
        (tmp_path / FILE).write_text(json.dumps(content))
        return read_views(tmp_path)[0]

    return read


NO_PINHOLES = [
    {"camera_model": "OPENCV_FISHEYE", "k1": 0.0}, {"camera_model": "EQUIRECTANGULAR"}, {"camera_model": "FISHEYE624"},
    {"camera_model": "VR180_L"}, {"camera_model": "OMNIDIRECTIONALSTEREO_L"}, {"camera_model": "ORTHOPHOTO"},
    {"camera_model": 3}, {"is_fisheye": True}, {"distortion_params": [0.1, 0, 0, 0]}, {"k5": 0.1}, {"k6": -0.1},
    {"p1": 1e-4}, {"p3": 0.1}, {"b1": 2.0}, {"s1": 0.1}, {"skew": 0.2}, {"ftheta_p0": 0.1}, {"k1": math.nan},
    {"fisheye_crop_radius": 100}, {"rolling_shutter": [0, 0, 0.5, 0]}, {"from_mitsuba": True}, {"from_na": True},
    {"equirectangular": True}, {"latlong": True},
]  # fmt: skip


@pytest.mark.parametrize("entries", NO_PINHOLES, ids=str)
@pytest.mark.parametrize("where", ["file", "frame"])
def test_cameras_that_are_no_pinholes_are_refused(read, entries, where):
    with pytest.raises(ValueError, match="is not modelled|convention"):
        read(entries) if where == "frame" else read(**entries)


def test_entries_that_change_no_picture_are_passed_over(read):
    """No warning: those are errors here."""
    plain = read()
    harmless = {
        "camera_model": "OPENCV", "k1": 0, "k2": 0.0, "p1": 0, "p2": None, "distortion_params": [0.0] * 6,
        "aabb_scale": 16, "scale": 0.3, "offset": [0.5, 0.5, 0.5], "up": [0, 0, 1], "applied_transform": [[1, 0, 0, 0]],
        "applied_scale": 0.2, "orientation_override": "none", "ply_file_path": "sparse.ply", "is_fisheye": False,
        "integer_depth_scale": 0.001, "enable_depth_loading": True, "rolling_shutter": [0, 0, 0, 0], "w": 12, "h": 8,
    }  # fmt: skip
    frame = {"sharpness": 30.1, "colmap_im_id": 3, "depth_file_path": "d.png", "rotation": 0.01, "near": 0.1}
    view = read(frame, **harmless)
    np.testing.assert_array_equal(view.image, plain.image)
    assert (view.fov, view.principal_point) == (plain.fov, plain.principal_point)


def test_unknown_entries_are_named(read):
    with pytest.warns(UserWarning, match="passed over: lens_coating, zoom"):
        read({"zoom": 2}, lens_coating=0.1)


def test_a_camera_of_a_frame_wins_over_that_of_the_file(read):
    assert read({"camera_angle_x": 0.5}, fl_x=100.0, fl_y=100.0).fov == pytest.approx(math.degrees(0.5))
    assert read({"fl_x": 12.0, "k1": 0.0}, k1=0.2).fov == pytest.approx(2 * math.degrees(math.atan(0.5)))
    assert read(x_fov=40.0, camera_angle_x=math.radians(40)).fov == pytest.approx(40)
    # the height alone: 8 pixels, square ones
    assert read({"camera_angle_x": None, "camera_angle_y": 2 * math.atan(4 / 12)}, camera_angle_x=None).fov == (
        pytest.approx(2 * math.degrees(math.atan(6 / 12)))
    )
    with pytest.raises(ValueError, match="two different fields of view"):
        read(fl_x=12.0, camera_angle_x=0.5)


def test_exposures_that_differ_are_refused(read, tmp_path):
    (tmp_path / "b.png").write_bytes((tmp_path / "a.png").read_bytes())
    content = poses("a.png")
    content["frames"] = [
        {**content["frames"][0], "file_path": f"{n}.png", "exposure": e} for n, e in zip("ab", (1, 2), strict=True)
    ]
    (tmp_path / FILE).write_text(json.dumps(content))
    with pytest.raises(ValueError, match="exposure differs between frames"):
        read_views(tmp_path)


@pytest.mark.parametrize("shape", [(3, 4), (12,), (16,), (4, 4)])
def test_matrices_of_three_rows_and_flat_ones(read, shape):
    pose = np.eye(4)
    pose[:3, 3] = 1, 2, 3
    matrix = pose[: 3 if 3 in shape or shape == (12,) else 4].reshape(shape)
    np.testing.assert_array_equal(read({"transform_matrix": matrix.tolist()}).to_world, pose)


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16", "utf-32"])
def test_encodings_of_the_poses(read, tmp_path, encoding):
    read()
    (tmp_path / FILE).write_text((tmp_path / FILE).read_text(), encoding=encoding)
    assert len(read_views(tmp_path)) == 1


def test_damaged_poses_are_never_to_be_deleted(read, tmp_path):
    (tmp_path / FILE).write_bytes(b"\xff{")
    with pytest.raises(ValueError, match="is no JSON") as error:
        read_views(tmp_path)
    assert not {"remove", "delete"} & set(str(error.value).replace(";", " ").split())


def test_splits_of_nerfstudio_and_nerf(read, tmp_path):
    Image.fromarray(np.full((8, 12, 3), 128, np.uint8)).save(tmp_path / "b.png")
    content = poses("a.png", train_filenames=["a.png"], val_filenames=["./b.png"])
    content["frames"] += [{**content["frames"][0], "file_path": "./b.png"}]
    (tmp_path / FILE).write_text(json.dumps(content))
    assert [v.split for v in read_views(tmp_path)] == ["train", "test"]
    (tmp_path / FILE).unlink()
    for name, file in (("train", "a"), ("test", "b")):  # without suffix, as the synthetic scenes have it
        (tmp_path / f"transforms_{name}.json").write_text(json.dumps(poses(file)))
    assert [(v.name, v.split) for v in read_views(tmp_path)] == [("a", "train"), ("b", "test")]


@pytest.mark.parametrize("ratio", [1.25, 0.8])
def test_pixels_that_are_not_square_are_resampled(llvm, ratio):
    """A picture of twice the pixels in one direction, averaged to `ratio`: the camera sees it again from there."""
    lit = {"type": "sphere", "center": [0.3, 0.2, 0], "emitter": {"type": "area", "radiance": 1.0}}
    scene = mi.load_dict({"type": "scene", "ball": lit})
    (camera,) = around(1, target=(0, 0, 0), distance=6, resolution=80)
    (fine,) = render_views(scene, [camera], spp=64)
    coarse = (64, 80) if ratio < 1 else (80, 64)  # pixels higher than wide, or wider than high
    step = 5 / 4
    # fine pixels of 1/5: each coarse one is 4 or 5 of them
    blocks = fine.image.repeat(4, 0).repeat(4, 1)
    tall = blocks.reshape(coarse[0], 320 // coarse[0], coarse[1], 320 // coarse[1], 3).mean((1, 3))
    view = View("v", tall.astype(np.float32), camera.to_world, camera.fov).with_square_pixels(ratio)
    side = int(80 / step)
    assert view.size == (side, side) and view.mask.all() and view.fov == pytest.approx(camera.fov)
    (again,) = render_views(scene, [dataclasses.replace(view, image=np.zeros_like(view.image))], spp=64)
    # means of means; the edge of the ball is a few pixels of all
    assert np.abs(again.image - view.image).mean() < 0.01


def test_resampling_keeps_the_principal_point_masks_and_what_is_saturated(read):
    view = read(fl_x=12.0, fl_y=24.0, cx=6.0, cy=3.0)
    assert view.size == (12, 4) and view.principal_point == pytest.approx((0.5, 3 / 8))
    image, mask = np.full((4, 2, 3), 0.5, np.float32), np.ones((4, 2), bool)
    image[:3], mask[0, 1] = 1.0, False
    small = View("v", image, np.eye(4), 30.0, mask, ceiling=1.0).with_square_pixels(2.0)
    # whole blocks: saturated; half a block, or half a mask: left out
    assert small.mask.tolist() == [[True, False], [False, False]] and small.saturated[0].all()


def test_entries_of_a_frame_hold_for_all_where_the_file_has_them(read, tmp_path):
    """A mask of a rig's shadow, a ceiling, a split."""
    mask = np.zeros((8, 12), np.uint8)
    mask[:2] = 255
    Image.fromarray(mask).save(tmp_path / "m.png")
    view = read(mask_path="m.png", ceiling=0.5, split="val")
    assert (view.mask.sum(), view.ceiling, view.split) == (24, 0.5, "test")
    assert read({"ceiling": 0.7}, ceiling=0.5).ceiling == 0.7
    with pytest.raises(ValueError, match="ceiling = 0; needed: positive"):
        read(ceiling=0)


@pytest.mark.parametrize(
    "name,value",
    [
        ("mask", "m.png"), ("alpha_path", "m.png"), ("white_transparent", True), ("mask_color", 255), ("K1", 0.1),
        ("distortion_coeffs", [0.1, 0]), ("lens_distortion", {"k": 0.1}), ("camera_type", "FISHEYE"), ("fisheye", True),
        ("is_panorama", 1), ("distortion_model", "KANNALA_FISHEYE"), ("projection", "equirectangular"),
        ("shift_x", 0.1), ("camera_convention", "opencv"), ("coordinate_system", "COLMAP"), ("pose_type", "w2c"),
    ],
)  # fmt: skip
def test_other_names_for_what_is_not_modelled_are_refused(read, name, value):
    with pytest.raises(ValueError, match=f"{name} = "):
        read({name: value})


def test_other_names_that_say_nothing_are_read(read):
    plain = read()
    view = read(K1="0.000", white_transparent=False, mask=None, distortion_params=["0.0", 0], w=12, h=8)
    assert (view.fov, view.mask.all()) == (plain.fov, True)
    assert read({"fx": 12.0, "fy": 12.0, "width": 12}).fov == pytest.approx(2 * math.degrees(math.atan(0.5)))
    with pytest.raises(ValueError, match="w says 13"):
        read(width=13)


@pytest.mark.parametrize(
    "entries,message", [({"cx": 0.5, "cy": 0.5}, "They are pixels"), ({"fl_x": 0.1, "fl_y": 0.1}, "needed: pixels")]
)
def test_shares_of_the_image_are_no_pixels(read, entries, message):
    with pytest.raises(ValueError, match=message):
        read(entries)


@pytest.mark.parametrize("name", ["exposure_time", "ISO", "f_number"])
def test_exposures_that_differ_between_files_are_refused(read, tmp_path, name):
    read()
    (tmp_path / FILE).unlink()
    for k, split in enumerate(("train", "test")):
        content = poses("a.png")
        content["frames"][0][name] = 1 + k
        (tmp_path / f"transforms_{split}.json").write_text(json.dumps(content))
    with pytest.raises(ValueError, match=f"{name.lower()} differs between frames"):
        read_views(tmp_path)


@pytest.mark.parametrize("name", ["photo", "photo.JPG", "PHOTO.jpg", ".\\photo.jpg"])
def test_names_from_systems_where_capitals_do_not_matter(read, tmp_path, name):
    read()
    Image.fromarray(np.full((8, 12, 3), 128, np.uint8)).save(tmp_path / "Photo.JPG")
    (tmp_path / FILE).write_text(json.dumps(poses(name)))
    assert len(read_views(tmp_path)) == 1


def test_lists_of_splits_name_frames_in_any_spelling(read, tmp_path):
    read()
    (tmp_path / FILE).write_text(json.dumps(poses("./a.png", train_filenames=["a.png"])))
    assert len(read_views(tmp_path)) == 1
    (tmp_path / FILE).write_text(json.dumps(poses("a.png", train_filenames=["a.png", "b.png"])))
    with pytest.raises(ValueError, match='name "b.png", which no frame has'):
        read_views(tmp_path)
