"""Entries of a ``transforms.json`` about the camera: each is honoured, refused, or known to change no picture.

The entries are those of nerfstudio, instant-ngp and its ``colmap2nerf``, Blender's NeRF exporters, and the converters
of Metashape, Polycam, Record3D, RealityCapture. The table is in docs/images.md.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from typing import Any, NamedTuple

from ..data.entries import Entries, number
from ..system.messages import shortened

_PINHOLES = ("PINHOLE", "SIMPLE_PINHOLE", "SIMPLE_RADIAL", "RADIAL", "OPENCV", "FULL_OPENCV", "PERSPECTIVE")
# Numbers, or lists of them, that bend the picture: k1..k6 radial, p1..p4 tangential, s1..s4 and sx, sy thin prism, b1,
# b2 affine.
_DISTORTION = re.compile(
    r"([kpsb]\d|s[xy]\d|skew|omega|((lens|radial|tangential)_)?distortions?(_(params|coeff?s?|coefficients))?"
    r"|dist_coeff?s|dist_params|ftheta_p\d|lens_params)$",
    re.IGNORECASE,
)
# In names or texts of other entries: cameras and conventions that tools have a word for, but no common entry.
_OTHER_CAMERA = re.compile(r"fish_?eye|equirect|panoram|spherical|omnidir|orthograph|ftheta|latlong", re.IGNORECASE)
_CONVENTION = re.compile(r"convention|coordinate|pose_type|pose_format", re.IGNORECASE)
_OTHER_CONVENTION = re.compile(r"opencv|colmap|w2c|world.?(to|2).?cam", re.IGNORECASE)
_RENAMED = "masks are read from mask_path. Rename it"
_CHROMA = "a colour that stands for transparency is not modelled. Give the images alpha, or a mask_path"
_SHIFT = "a shifted lens is told by cx and cy, in pixels. Give these"
# Other cameras, and other conventions of poses: entry, and what to do about it. 0, false, null and [] say nothing.
_REFUSED = {
    "is_fisheye": "a fisheye camera is not modelled. Undistort the images to a pinhole camera",
    "fisheye_crop_radius": "a fisheye camera is not modelled. Undistort the images to a pinhole camera",
    "ftheta": "an f-theta camera is not modelled. Undistort the images to a pinhole camera",
    "equirectangular": "a panorama is not modelled. Cut pinhole images out of it",
    "latlong": "a panorama is not modelled. Cut pinhole images out of it",
    "orthographic": "an orthographic camera is not modelled",
    "ortho_scale": "an orthographic camera is not modelled",
    "rolling_shutter": "a rolling shutter is not modelled. Take images from a camera that stands still",
    "transform_matrix_start": "a moving camera is not modelled. Take images from a camera that stands still",
    "transform_matrix_end": "a moving camera is not modelled. Take images from a camera that stands still",
    "from_mitsuba": "poses are expected in OpenGL's convention. Turn each by half a turn about its y axis",
    "from_na": "poses are expected in OpenGL's convention. Turn them into it",
    **dict.fromkeys(
        ("mask", "mask_file", "mask_file_path", "mask_filename", "alpha_path", "alpha_mask_path"), _RENAMED
    ),
    **dict.fromkeys(("white_transparent", "black_transparent", "mask_color"), _CHROMA),
    **dict.fromkeys(("shift_x", "shift_y", "lens_shift", "lens_shift_x", "lens_shift_y"), _SHIFT),
    "crop": "write the images that are left of a crop, with their own w, h, cx, cy",
}
_CAMERA = ("fl_x", "fl_y", "x_fov", "y_fov", "camera_angle_x", "camera_angle_y", "cx", "cy", "w", "h", "camera_model")
# Honoured by view_files.py.
_READ = (
    "frames", "file_path", "transform_matrix", "mask_path", "split", "ceiling", "light", "exposure_factor",
    "train_filenames", "val_filenames", "test_filenames",
)  # fmt: skip
# About other things than the picture: settings of a training, depth, names, how the poses came to be.
_HARMLESS = """
    aabb aabb_scale scale offset render_aabb up avglen n_frames n_extra_learnable_dims
    sharpness sharpness_discard_threshold importance_sampling wants_importance_sampling envmap light_dir
    info fix_premult
    enable_depth_loading enable_ray_loading integer_depth_scale
    depth_unit_scale_factor depth_file_path depth_path depth_scale rays_path normal_path normal_file_path semantic_path
    sensor_depth_path mono_depth_path mono_normal_path has_mono_prior confidence_path sharp
    applied_transform applied_scale orientation_override auto_scale_poses_override scene_box ply_file_path sparse_pc
    colmap_im_id colmap_image_id colmap_camera_id camera_id cam_id camera_name image_id id name label rotation
    driver_parameters timestamp time frame frame_id frame_index near far near_plane far_plane worldtogt metadata version
    generator description comment dataset scene units unit up_axis
""".split()
# Of a camera's settings: photographs that differ in them are not of one brightness or colour.
_SAME_FOR_ALL = """
    exposure exposure_time exposure_value ev shutter shutter_speed iso iso_speed aperture f_number fnumber gain
    white_balance
""".split()
_SQUARE = 2e-4  # relative difference of fl_x and fl_y that moves no pixel: half of one at the edge of 5,000
_SHORTEST = 0.01  # focal length as a share of the width: less sees 179 degrees, and is in other units
_AGREE = 0.02  # by how much two entries for one field of view may differ, relatively: more is a mistake


class Intrinsics(NamedTuple):
    """Of a pinhole camera, in pixels."""

    focal_x: float
    focal_y: float
    center_x: float
    center_y: float

    @property
    def is_square(self) -> bool:
        """True if pixels are as wide as high."""
        return abs(self.focal_y / self.focal_x - 1) <= _SQUARE


def unknown_entries(entries: Entries) -> list[str]:
    """Names of entries that mean nothing to this package."""
    known = {*_READ, *_CAMERA, *_HARMLESS, *_REFUSED, *_SAME_FOR_ALL}
    return [n for n in entries if n not in known and n.lower() not in _SAME_FOR_ALL and not _DISTORTION.match(n)]


def check_camera(entries: Entries, where: str) -> None:
    """Refuse every camera that is no pinhole, and poses in another convention.

    Raises
    ------
    ValueError
    """
    for name, value in entries.items():
        if _DISTORTION.match(name) and _says_something(value):
            raise ValueError(
                f"{where}: lens distortion ({name} = {shortened(value)}) is not modelled. Undistort the "
                "images, set it to 0."
            )
        if name in _REFUSED and _says_something(value):
            raise ValueError(f"{where}: {name} = {shortened(value)}: {_REFUSED[name]}.")
    for name in unknown_entries(entries):
        value, text = entries[name], f"{name} {entries[name] if isinstance(entries[name], str) else ''}"
        if _says_something(value) and _OTHER_CAMERA.search(text):
            raise ValueError(f"{where}: {name} = {shortened(value)}: not modelled. Make pinhole images of it.")
        if _CONVENTION.search(name) and _OTHER_CONVENTION.search(text):
            raise ValueError(
                f"{where}: {name} = {shortened(value)}: poses are expected in OpenGL's convention, camera to world. "
                "Turn them into it."
            )
    model = entries.get("camera_model")
    if model is not None and (not isinstance(model, str) or model.upper() not in _PINHOLES):
        raise ValueError(
            f"{where}: camera_model {shortened(model)} is not modelled; read are {', '.join(_PINHOLES)}, without "
            "distortion. Undistort the images to a pinhole camera."
        )


def check_same_for_all(all_entries: list[Entries], where: str) -> None:
    """Refuse photographs whose settings differ, where they are told: one brightness means one radiance.

    Raises
    ------
    ValueError
    """
    for name in _SAME_FOR_ALL:
        values = {
            repr(value)
            for entries in all_entries
            for own, value in entries.items()
            if own.lower() == name and value is not None
        }
        if len(values) > 1:
            raise ValueError(
                f"{where}: {name} differs between frames ({', '.join(sorted(values)[:3])}), which is not "
                "modelled. Bring the images to one brightness and colour, or say by exposure_factor how many times "
                "as bright each is, and leave it out."
            )


def intrinsics(content: Entries, frame: Entries, width: int, height: int, where: str) -> Intrinsics:
    """Return focal lengths and principal point; what a frame says of its camera wins over what the file says of all.

    Raises
    ------
    ValueError
        If no entry tells the field of view, two contradict each other, or one is no number in its range.
    """
    for own in (frame, content):
        x = _focal(own, ("fl_x", "x_fov", "camera_angle_x"), width, where)
        y = _focal(own, ("fl_y", "y_fov", "camera_angle_y"), height, where)
        if x or y:
            break
    else:
        raise ValueError(f"{where}: neither camera_angle_x (radians) nor fl_x (pixels) is given. One is needed.")
    both = merged(content, frame)
    cx, cy = number(both, "cx", width / 2, where), number(both, "cy", height / 2, where)
    if 0 < cx <= 1 and 0 < cy <= 1 and min(width, height) > 4:
        raise ValueError(f"{where}: cx = {cx:g}, cy = {cy:g}: shares of the image? They are pixels.")
    return Intrinsics(x or y, y or x, cx, cy)


def merged(content: Entries, frame: Entries) -> dict[str, Any]:
    """Return the entries that hold for a frame; what is null is not there."""
    return {name: value for entries in (content, frame) for name, value in entries.items() if value is not None}


def _focal(entries: Entries, names: tuple[str, str, str], size: int, where: str) -> float:
    """Focal length in pixels along one side, 0 if nothing tells it."""
    length, degrees, radians = names
    found = {}
    if entries.get(length) is not None:
        found[length] = number(entries, length, 0, where)
        if not _SHORTEST * size < found[length] < 1e6 * size:
            raise ValueError(
                f"{where}: {length} = {found[length]:g} pixels; needed: pixels, positive, about the width of the image."
            )
    for name, unit, full in ((degrees, "degrees", 180.0), (radians, "radians", math.pi)):
        if entries.get(name) is not None:
            angle = number(entries, name, 0, where)
            if not 0 < angle < full:
                end = "pi" if unit == "radians" else "180"
                raise ValueError(f"{where}: {name} = {angle:g}; it is in {unit}, between 0 and {end}.")
            found[name] = size / (2 * math.tan(angle / full * math.pi / 2))
    if not found:
        return 0.0
    lengths = list(found.values())
    if max(lengths) > (1 + _AGREE) * min(lengths):
        text = " and ".join(f"{name} ({value:.5g} pixels)" for name, value in found.items())
        raise ValueError(f"{where}: {text} are two different fields of view of {size} pixels. Correct one.")
    return lengths[0]


def _says_something(value: object) -> bool:
    """False for 0, false, null, "" and lists and objects of them; text counts, unless it is a zero."""
    if isinstance(value, Mapping):
        return any(_says_something(v) for v in value.values())
    if isinstance(value, (list, tuple)):
        return any(_says_something(v) for v in value)
    if isinstance(value, str):
        try:
            return float(value) != 0
        except ValueError:
            return value.strip().lower() not in ("", "false", "none")
    return bool(value)
