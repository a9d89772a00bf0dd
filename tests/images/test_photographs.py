"""Photographs and masks in all the forms that cameras and programs write."""

from __future__ import annotations

import json
import struct
import zlib

import numpy as np
import OpenEXR
import pytest
from photograph_damage import HEIGHT, WIDTH, exr, png, poses, rows, samples, window
from PIL import Image, ImageCms

import mi_enhance  # noqa: F401  (before mitsuba)

import mitsuba as mi  # isort: skip

from mi_enhance.data.image_files.colour_spaces import ADOBE_RGB, decode_srgb
from mi_enhance.images.view_files import FILE, read_views, write_views
from mi_enhance.images.views import View

HALF = np.full((HEIGHT, WIDTH), 0.5, np.float32)


@pytest.fixture
def read(llvm, tmp_path):
    """Read a file of the folder as a photograph, or beside one as its mask."""

    def read(name, content=None, **entries):
        if content is not None:
            (tmp_path / name).write_bytes(content)
        (tmp_path / FILE).write_text(json.dumps(poses(name, **entries)))
        return read_views(tmp_path)[0]

    return read


def eight_bits(value, channels=3, *chunks, colour=2, depth=8):
    pixels = np.full((HEIGHT, WIDTH, channels), value, np.uint8 if depth == 8 else np.uint16)
    return png((WIDTH, HEIGHT, depth, colour, 0, 0, 0), rows(pixels), *chunks)


# ---------------------------------------------------------------------- alpha and masks


def square(opaque=1.0, elsewhere=0.0):
    alpha = np.full((HEIGHT, WIDTH), elsewhere, np.float32)
    alpha[2:4, 3:6] = opaque
    return alpha


@pytest.mark.parametrize("kind", ["RGBA", "LA", "palette", "tRNS", "16 bits", "EXR", "EXR of layers"])
def test_alpha_is_the_mask(read, tmp_path, kind):
    alpha, path = square(), tmp_path / "a.png"
    inside = alpha > 0
    if kind in ("RGBA", "LA"):
        grey = np.where(inside, 200, 17).astype(np.uint8)
        Image.fromarray(np.dstack([grey] * (len(kind) - 1) + [(255 * alpha).astype(np.uint8)]), kind).save(path)
    elif kind == "palette":
        image = Image.fromarray(inside.astype(np.uint8), "P")
        image.putpalette([0, 0, 255, 200, 200, 200])
        image.save(path, transparency=0)
    elif kind == "tRNS":
        pixels = np.where(inside[..., None], 200, (1, 2, 3)).astype(np.uint8)
        path.write_bytes(png((WIDTH, HEIGHT, 8, 2, 0, 0, 0), rows(pixels), (b"tRNS", struct.pack(">3H", 1, 2, 3))))
    elif kind == "16 bits":
        pixels = np.dstack([np.full((HEIGHT, WIDTH, 3), 200), 255 * alpha]).astype(np.uint16) * 257
        path.write_bytes(png((WIDTH, HEIGHT, 16, 6, 0, 0, 0), rows(pixels)))
    else:
        path, prefix = tmp_path / "a.exr", "ViewLayer.Combined." if "layers" in kind else ""
        colour = decode_srgb(np.float64(200 / 255)).astype(np.float32)
        exr(path, {**{f"{prefix}{c}": colour * alpha for c in "RGB"}, f"{prefix}A": alpha})
    view = read(path.name)
    np.testing.assert_array_equal(view.mask, inside)
    np.testing.assert_allclose(view.image[inside], decode_srgb(np.array(200 / 255)), rtol=1e-5)


def test_partly_covered_pixels_do_not_count_and_exr_is_premultiplied(read, tmp_path):
    """What is behind half of a pixel is not known; the same picture straight and premultiplied has one colour."""
    alpha = square(1, 128 / 255)
    straight = np.dstack([np.full((HEIGHT, WIDTH, 3), 200), 255 * alpha]).astype(np.uint8)
    Image.fromarray(straight, "RGBA").save(tmp_path / "a.png")
    linear = np.float32(decode_srgb(np.array(200 / 255)))
    exr(tmp_path / "b.exr", {"RGB": np.repeat((linear * alpha)[..., None], 3, 2), "A": alpha})
    a, b = read("a.png"), read("b.exr")
    assert a.mask.sum() == b.mask.sum() == 6
    np.testing.assert_allclose(a.image, b.image, rtol=1e-5)


@pytest.mark.parametrize("drawn", ["white", "black", "both", "grey", "colour", "1 bit"])
def test_masks(read, tmp_path, drawn):
    """By their colour, by their alpha, or by both."""
    shape, path = square(), tmp_path / "m.png"
    ink = (255 * shape).astype(np.uint8)
    if drawn == "1 bit":
        Image.fromarray(ink).convert("1").save(path)
    elif drawn in ("grey", "colour"):
        Image.fromarray(ink if drawn == "grey" else np.dstack([0 * ink, ink, 0 * ink])).save(path)
    else:
        colour = {"white": np.full_like(ink, 255), "black": 0 * ink, "both": ink}[drawn]
        Image.fromarray(np.dstack([colour] * 3 + [ink]), "RGBA").save(path)
    view = read("a.png", eight_bits(128), mask_path="m.png")
    np.testing.assert_array_equal(view.mask, shape > 0)


def test_a_black_mask_among_many_leaves_one_view_out(read, tmp_path):
    for name, value in (("a.png", 128), ("b.png", 128), ("black.png", 0)):
        (tmp_path / name).write_bytes(eight_bits(value))
    content = poses("a.png")
    content["frames"] += [{**content["frames"][0], "file_path": "b.png", "mask_path": "black.png"}]
    (tmp_path / FILE).write_text(json.dumps(content))
    with pytest.warns(UserWarning, match="1 of 2 views left out, no pixel counts: b.png"):
        assert [v.name for v in read_views(tmp_path)] == ["a"]


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
def test_what_is_masked_may_be_anything(read, tmp_path, value):
    image = np.full((HEIGHT, WIDTH, 3), 0.5, np.float32)
    image[0, :2] = value
    mi.Bitmap(image).write(str(tmp_path / "a.exr"))
    with pytest.raises(ValueError, match="a.exr holds 6 values.*mask_path"):
        read("a.exr")
    mask = np.full((HEIGHT, WIDTH), 255, np.uint8)
    mask[0, :2] = 0
    Image.fromarray(mask).save(tmp_path / "m.png")
    view = read("a.exr", mask_path="m.png")
    assert view.mask.sum() == WIDTH * HEIGHT - 2 and np.isfinite(view.image).all()
    assert np.isfinite(view.smaller(2).image).all()


# ---------------------------------------------------------------------- EXR


@pytest.mark.parametrize("kind", ["scanlineimage", "tiledimage"])
@pytest.mark.parametrize("data", [(4, 1, 4, 4), (-2, -1, 13, 11), (3, 2, 20, 1), (0, 0, 9, 7)], ids=str)
def test_data_window_lies_in_the_display_window(read, tmp_path, kind, data):
    full = np.zeros((HEIGHT, WIDTH), bool)
    x, y, width, height = data
    full[max(y, 0) : y + height, max(x, 0) : x + width] = True
    ramp = 1 + np.add.outer(np.arange(y, y + height), 100 * np.arange(x, x + width)).astype(np.float32)
    how = {"dataWindow": window(*data), "displayWindow": window(0, 0, WIDTH, HEIGHT), "type": getattr(OpenEXR, kind)}
    how |= {"tiles": OpenEXR.TileDescription()} if kind == "tiledimage" else {}
    exr(tmp_path / "a.exr", {"RGB": np.repeat(ramp[..., None], 3, 2)}, **how)
    view = read("a.exr")
    assert view.size == (WIDTH, HEIGHT)
    np.testing.assert_array_equal(view.mask, full)
    expected = 1 + np.add.outer(np.arange(HEIGHT), 100 * np.arange(WIDTH))
    np.testing.assert_array_equal(view.image[full][:, 1], expected[full])


def test_display_window_need_not_begin_at_0(read, tmp_path):
    how = {"dataWindow": window(10, 20, WIDTH, HEIGHT), "displayWindow": window(10, 20, WIDTH, HEIGHT)}
    exr(tmp_path / "a.exr", {"RGB": np.repeat(HALF[..., None], 3, 2)}, **how)
    assert read("a.exr").mask.all() and (read("a.exr").image == 0.5).all()


LAYERS = {
    "depth": [*"RGB", "Z"], "layers": [*"RGB", *(f"albedo.{c}" for c in "RGB")], "lower case": [*"rgb"],
    "Blender": [*(f"ViewLayer.Combined.{c}" for c in "RGB"), *(f"ViewLayer.Normal.{c}" for c in "XYZ")],
    "one layer": ["photo.R", "photo.G", "photo.B", "depth.Z"], "grey": ["Y"],
}  # fmt: skip


@pytest.mark.parametrize("kind", LAYERS)
def test_the_channels_that_are_the_picture(read, tmp_path, kind):
    first = ("R", "r", "ViewLayer.Combined.R", "photo.R", "Y")
    exr(tmp_path / "a.exr", {c: HALF * (1 + (c not in first) / 2) for c in LAYERS[kind]})
    assert read("a.exr").image[0, 0, 0] == 0.5 and read("a.exr").image.shape == (HEIGHT, WIDTH, 3)


@pytest.mark.parametrize(
    "names", [["Z"], ["X", "Y", "Z"], ["Y", "RY", "BY"], ["R", "G"], ["a.R", "a.G", "a.B", "b.R", "b.G", "b.B"]]
)
def test_channels_that_are_no_picture_are_named(read, tmp_path, names):
    exr(tmp_path / "a.exr", dict.fromkeys(names, HALF))
    with pytest.raises(ValueError, match=f"a.exr: which of its channels.*{sorted(names)[0]}"):
        read("a.exr")


def test_exr_of_other_primaries_is_converted(read, tmp_path):
    """Red of Adobe RGB is redder than that of sRGB: 1.4 of it, and negative green."""
    red = np.zeros((HEIGHT, WIDTH, 3), np.float32)
    red[..., 0] = 1
    exr(tmp_path / "a.exr", {"RGB": red}, chromaticities=ADOBE_RGB)
    # both spaces have one white and one blue; Adobe RGB (1998), annex A
    np.testing.assert_allclose(read("a.exr").image[0, 0], [1.3984, 0, 0], atol=2e-3)


@pytest.mark.parametrize("name", ["deep.exr", "cmyk.jpg"])
def test_what_cannot_be_honoured_is_refused(read, tmp_path, name):
    with pytest.raises(ValueError, match="deep|CMYK"):
        read(name, samples(tmp_path)[name])


def test_samples_of_the_fuzzing_are_read(read, tmp_path):
    for name, content in samples(tmp_path).items():
        if name not in ("deep.exr", "cmyk.jpg", FILE):
            assert read(name, content).image.mean() > 0.05, name


# ---------------------------------------------------------------------- PNG and JPEG


@pytest.mark.parametrize(
    "depth,value,ceiling", [(8, 255, True), (8, 254, False), (16, 65535, True), (16, 65534, False)]
)
def test_saturation_is_that_of_the_depth(read, depth, value, ceiling):
    view = read("a.png", eight_bits(value, depth=depth))
    assert view.saturated.all() == view.saturated.any() == ceiling
    np.testing.assert_allclose(view.image, decode_srgb(np.array(value / (2**depth - 1))), rtol=1e-6)


def test_saturation_of_12_bits_in_16(read):
    assert read("a.png", eight_bits(4095 << 4, 3, (b"sBIT", b"\x0c\x0c\x0c"), depth=16)).saturated.all()
    assert not read("a.png", eight_bits(4094 << 4, 3, (b"sBIT", b"\x0c\x0c\x0c"), depth=16)).saturated.any()


CHUNKS = {
    "sRGB": ((b"sRGB", b"\0"), decode_srgb), "gamma 1": ((b"gAMA", struct.pack(">I", 100000)), lambda v: v),
    "gamma 1/1.8": ((b"gAMA", struct.pack(">I", 55556)), lambda v: v**1.8), "none": ((b"tIME", b"\0" * 7), decode_srgb),
    "linear cICP": ((b"cICP", bytes([1, 8, 0, 1])), lambda v: v),
    "gamma of sRGB": ((b"gAMA", struct.pack(">I", 45455)), decode_srgb),
}  # fmt: skip


@pytest.mark.parametrize("kind", CHUNKS)
@pytest.mark.parametrize("channels,colour", [(3, 2), (1, 0), (4, 6)])
def test_gamma_of_png(read, kind, channels, colour):
    chunk, decode = CHUNKS[kind]
    pixels = np.full((HEIGHT, WIDTH, channels), 100, np.uint8)
    pixels[..., 3:] = 255
    view = read("a.png", png((WIDTH, HEIGHT, 8, colour, 0, 0, 0), rows(pixels), chunk))
    np.testing.assert_allclose(view.image, decode(np.array(100 / 255)), rtol=1e-4)


@pytest.mark.parametrize(
    "chunk", [(b"cICP", bytes([9, 16, 0, 1])), (b"gAMA", b"\0\0\0\0"), (b"cHRM", b"\0" * 32)], ids=str
)
def test_colours_that_cannot_be_told_are_refused(read, chunk):
    with pytest.raises(ValueError, match="a.png: its colours cannot be told"):
        read("a.png", eight_bits(100, 3, chunk))


def test_icc_profiles(read, tmp_path):
    """That of sRGB changes nothing; Adobe RGB is converted, and a saturated pixel of it does not count."""
    srgb = ImageCms.ImageCmsProfile(ImageCms.createProfile("sRGB")).tobytes()
    image = Image.fromarray(np.full((HEIGHT, WIDTH, 3), 100, np.uint8))
    image.save(tmp_path / "a.png", icc_profile=srgb)
    np.testing.assert_allclose(read("a.png").image, decode_srgb(np.array(100 / 255)), rtol=1e-5)
    lab = ImageCms.ImageCmsProfile(ImageCms.createProfile("LAB")).tobytes()
    image.save(tmp_path / "b.jpg", icc_profile=lab)
    with pytest.raises(ValueError, match="ICC profile"):
        read("b.jpg")
    pixels = np.full((HEIGHT, WIDTH, 3), (200, 100, 100), np.uint8)
    pixels[0, 0, 0] = 255
    gamma = (b"gAMA", struct.pack(">I", round(1e5 * 256 / 563)))
    primaries = np.round(np.roll(ADOBE_RGB, 2) * 1e5).astype(int)
    adobe = png((WIDTH, HEIGHT, 8, 2, 0, 0, 0), rows(pixels), gamma, (b"cHRM", struct.pack(">8I", *primaries)))
    view = read("c.png", adobe)
    linear = (np.array([200, 100, 100]) / 255) ** (563 / 256)
    # Adobe RGB (1998), annex A: 1.3984 R - 0.3984 G, G, -0.0429 G + 1.0429 B
    truth = [1.3984 * linear[0] - 0.3984 * linear[1], linear[1], linear[1]]
    np.testing.assert_allclose(view.image[1, 1], truth, atol=2e-3)
    assert not view.mask[0, 0] and view.mask.sum() == WIDTH * HEIGHT - 1


@pytest.mark.parametrize("orientation", range(1, 9))
def test_orientation_is_honoured(read, tmp_path, orientation):
    """As Pillow turns it; not where w and h are those of the image as it is stored."""
    from PIL import ImageOps

    exif = Image.Exif()
    exif[0x0112] = orientation
    image = Image.fromarray(np.arange(WIDTH * HEIGHT, dtype=np.uint8).reshape(HEIGHT, WIDTH) * 4)
    image.save(tmp_path / "a.jpg", exif=exif, quality=100)
    stored = Image.open(tmp_path / "a.jpg")
    truth = np.asarray(ImageOps.exif_transpose(stored)) / 255
    np.testing.assert_allclose(read("a.jpg").image[..., 0], decode_srgb(truth), rtol=1e-5)
    if orientation >= 5:
        view = read("a.jpg", w=WIDTH, h=HEIGHT)
        np.testing.assert_allclose(view.image[..., 0], decode_srgb(np.asarray(stored) / 255), rtol=1e-5)


@pytest.mark.parametrize("suffix", ["jpg", "png"])
def test_exposures_of_exif_that_differ_are_told(read, tmp_path, suffix):
    def photographed(name, seconds, iso):
        exif = Image.Exif()
        exif[0x010F] = "maker"
        exif.get_ifd(0x8769).update({0x829A: seconds, 0x8827: iso, 0x829D: 4.0})  # time, ISO, f-number
        Image.new("RGB", (WIDTH, HEIGHT), (128, 128, 128)).save(tmp_path / f"{name}.{suffix}", exif=exif)

    content = poses(f"a.{suffix}")
    content["frames"] += [{**content["frames"][0], "file_path": f"b.{suffix}"}]
    (tmp_path / FILE).write_text(json.dumps(content))
    photographed("a", 0.01, 400)
    photographed("b", 0.04, 100)
    assert len(read_views(tmp_path)) == 2  # as much light, pytest would raise for a warning
    photographed("b", 0.04, 400)
    with pytest.warns(UserWarning, match="exposed 4 times as much as others"):
        read_views(tmp_path)


@pytest.mark.parametrize("name", ["rgb.png", "baseline.jpg", "progressive.jpg", "zip.exr", "tiled.exr"])
def test_files_that_are_cut_off_are_refused(read, tmp_path, name):
    content = samples(tmp_path)[name]
    for share in (0.3, 0.6, 0.9):
        with pytest.raises(ValueError, match=f"{name} cannot be read as an image"):
            read(name, content[: int(share * len(content))])


def test_sizes_that_no_file_can_hold_are_refused_before_memory_is_asked_for(read):
    for size in ((2**31 - 1, 2**31 - 1), (40_000, 40_000), (10_000, 10_000), (0, 5)):
        header = struct.pack(">IIBBBBB", *size, 8, 2, 0, 0, 0)
        content = eight_bits(100)
        broken = content[:16] + header + struct.pack(">I", zlib.crc32(b"IHDR" + header)) + content[33:]
        with pytest.raises(ValueError, match="pixels"):
            read("a.png", broken)


# ---------------------------------------------------------------------- round trips


def test_what_was_read_is_written_and_read_again(read, tmp_path):
    """Mask, split, principal point, pixels that were not square, and where an 8-bit photograph was saturated."""
    mask = np.full((HEIGHT, WIDTH), 255, np.uint8)
    mask[:2, :3] = 0
    Image.fromarray(mask).save(tmp_path / "m.png")
    pixels = np.random.default_rng(0).integers(200, 256, (HEIGHT, WIDTH, 3), np.uint8)
    pixels[4:] = 255
    content = png((WIDTH, HEIGHT, 8, 2, 0, 0, 0), rows(pixels))
    view = read("a.png", content, mask_path="m.png", split="test", fl_x=9.0, fl_y=11.0, cx=4.0, cy=2.5)
    for suffix in (".exr", ".png"):
        (again,) = read_views(write_views([view], tmp_path / suffix[1:], suffix=suffix))
        np.testing.assert_allclose(again.image, view.image, atol=0 if suffix == ".exr" else 2.4 * 0.5 / 255)
        np.testing.assert_array_equal(again.mask, view.mask)
        np.testing.assert_array_equal(again.saturated, view.saturated)
        assert (again.name, again.split, again.size) == (view.name, "test", view.size)
        assert again.principal_point == pytest.approx(view.principal_point) and again.fov == pytest.approx(view.fov)


def test_photographs_are_made_smaller_as_they_are_read(read, tmp_path):
    view = read("a.png", eight_bits(128))
    small = read_views(tmp_path, factor=np.int64(2))[0]
    assert small.size == (WIDTH // 2, HEIGHT // 2) and small.name == view.name
    with pytest.raises(ValueError, match="positive integer"):
        read_views(tmp_path, factor=0)


@pytest.mark.parametrize("ceiling", [0.3, 0.8, 1.0, np.inf])
def test_png_files_keep_where_a_view_is_saturated(llvm, tmp_path, ceiling):
    image = np.full((4, 4, 3), min(ceiling, 5), np.float32)
    image[0] = 0.1
    view = View("a", image, np.eye(4), 40.0, ceiling=ceiling)
    (again,) = read_views(write_views([view], tmp_path, suffix=".png"))
    np.testing.assert_array_equal(again.saturated[:, 0, 0], [False, True, True, True])


@pytest.mark.parametrize("name", ["A", "mask", "Z", "Y", "ViewLayer.Mask.X"])
def test_a_mask_may_be_the_only_channel_of_an_exr_file(read, tmp_path, name):
    exr(tmp_path / "m.exr", {name: square()})
    np.testing.assert_array_equal(read("a.png", eight_bits(128), mask_path="m.exr").mask, square() > 0)
