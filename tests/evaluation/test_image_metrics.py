"""Losses and image metrics against numbers worked out by hand or by another formula."""

from __future__ import annotations

import drjit as dr
import mitsuba as mi
import numpy as np
import pytest

from mi_enhance.evaluation import image_metrics
from mi_enhance.fitting import losses
from mi_enhance.output import srgb

METRICS = (
    image_metrics.ssim,
    image_metrics.delta_E_ITP,
    image_metrics.delta_E_ITP_map,
    image_metrics.psnr,
    image_metrics.mean_abs_log,
)
ROUNDING = 1e-6  # float32 logarithms and sums


@pytest.fixture
def image():
    return np.random.default_rng(0).uniform(0, 1, (24, 20, 3))


# --- loss -------------------------------------------------------------------------------------------------------------


def test_log_l1_is_equation_1_by_hand():
    f, f_gt, cos = np.array([[0.0], [2.0]]), np.array([[1.0], [2.0]]), np.array([0.5, 0.25])
    assert losses.log_l1(f, f_gt, cos) == pytest.approx(np.log(1.5) / 2)  # the second sample is exact


def test_log_l1_numpy_equals_drjit(llvm, image):
    f, f_gt = image.reshape(-1, 3), image[::-1].reshape(-1, 3)
    cos = f[:, 0]
    drjit = losses.log_l1(mi.Color3f(f.T), mi.Color3f(f_gt.T), mi.Float(cos))
    assert losses.log_l1(f, f_gt, cos) == pytest.approx(drjit[0], rel=ROUNDING)


def test_log_l1_gradient_is_sign_over_one_plus_f(llvm):
    f = mi.Float(0.5, 3.0)
    dr.enable_grad(f)
    dr.backward(losses.log_l1(f, mi.Float(1.0, 1.0), 1.0))
    assert np.allclose(dr.grad(f), [-1 / 1.5 / 2, 1 / 4.0 / 2], rtol=ROUNDING)


# --- image metrics ----------------------------------------------------------------------------------------------------


def test_identical_images_are_perfect(image):
    assert image_metrics.ssim(image, image) == pytest.approx(1, abs=1e-12)
    assert image_metrics.delta_E_ITP(image, image) == 0
    assert image_metrics.mean_abs_log(image, image) == 0
    assert image_metrics.psnr(image, image) == np.inf


def test_ssim_of_constant_images_is_its_luminance_term():
    # without structure, SSIM is (2 a b + C1) / (a^2 + b^2 + C1), C1 = 0.01^2, of the sRGB-encoded values
    a, b = 0.735357, 0.537099  # encoded 0.5 and 0.25
    expected = (2 * a * b + 1e-4) / (a * a + b * b + 1e-4)
    result = image_metrics.ssim(np.full((16, 16, 3), 0.5), np.full((16, 16, 3), 0.25))
    assert result == pytest.approx(expected, abs=1e-5)


def test_ssim_is_blind_above_white_and_delta_e_is_not(image):
    bright = image + 1
    assert image_metrics.ssim(bright, bright + 3) == pytest.approx(1, abs=1e-12)
    assert image_metrics.delta_E_ITP(bright, bright + 3) > 0.01


def test_ssim_falls_with_noise(image):
    noise = np.random.default_rng(1).normal(size=image.shape)
    assert 1 > image_metrics.ssim(image + 0.01 * noise, image) > image_metrics.ssim(image + 0.1 * noise, image) > 0


def test_delta_e_of_greys_is_the_difference_of_pq_codes():
    # Grey has Ct = Cp = 0 and I = PQ(luminance). SMPTE ST 2084 at 100 cd/m2: 0.508078; at 50 cd/m2: 0.440282.
    a, b = np.full((2, 2, 3), 1.0), np.full((2, 2, 3), 0.5)
    assert image_metrics.delta_E_ITP(a, b) == pytest.approx(_pq(100) - _pq(50), abs=1e-6)
    assert _pq(100) == pytest.approx(0.508078, abs=1e-6)


def test_delta_e_of_colours_is_the_matrix_of_bt_2100():
    a, b = np.array([0.8, 0.2, 0.1]), np.array([0.7, 0.25, 0.1])
    expected = np.linalg.norm(_itp(a) - _itp(b))
    # 1e-4 of the distance: the published sRGB to BT.2020 matrix has four digits
    assert image_metrics.delta_E_ITP(a[None, None], b[None, None]) == pytest.approx(expected, rel=1e-3)


def test_delta_e_map_is_local_and_its_mean_is_the_number(image):
    other = image.copy()
    other[3, 5] += 0.2
    error = image_metrics.delta_E_ITP_map(other, image)
    assert np.argwhere(error > 0).tolist() == [[3, 5]]
    assert image_metrics.delta_E_ITP(other, image) == pytest.approx(error[3, 5] / error.size)


def test_delta_e_takes_negative_radiance_as_black(image):
    assert image_metrics.delta_E_ITP(np.full_like(image, -0.1), np.zeros_like(image)) == 0


def test_psnr_by_hand():
    # encoded 0 and 1 in half of the pixels: mean squared error 1/2, so 10 log10(2) dB
    a, b = np.zeros((2, 2, 3)), np.zeros((2, 2, 3))
    b[0] = 1
    assert image_metrics.psnr(a, b) == pytest.approx(10 * np.log10(2))


def test_mean_abs_log_by_hand():
    assert image_metrics.mean_abs_log(np.full((2, 2, 3), 3.0), np.full((2, 2, 3), 1.0)) == pytest.approx(np.log(2))


def test_encode_srgb_is_what_mitsuba_writes(llvm):
    linear = np.linspace(0, 1, 300, dtype=np.float32).reshape(10, 10, 3)
    written = mi.Bitmap(linear).convert(mi.Bitmap.PixelFormat.RGB, mi.Struct.Type.Float32, srgb_gamma=True)
    assert np.allclose(np.array(written), srgb.encode_srgb(linear), atol=1e-5)


@pytest.mark.parametrize("metric", METRICS, ids=lambda m: m.__name__)
def test_wrong_images_are_refused(metric, image):
    with pytest.raises(ValueError, match=rf"{metric.__name__.removesuffix('_map')}.*\(24, 20, 3\) and \(12, 20, 3\)"):
        metric(image, image[:12])
    with pytest.raises(ValueError, match=r"same shape \(H, W, 3\)"):
        metric(image[..., 0], image[..., 0])
    broken = image.copy()
    broken[0, 0, 0] = np.nan
    with pytest.raises(ValueError, match="truth holds 1 values that are NaN"):
        metric(image, broken)


def test_ssim_refuses_images_smaller_than_its_window():
    with pytest.raises(ValueError, match="10 x 30 pixels; the window needs at least 11 x 11"):
        image_metrics.ssim(np.zeros((10, 30, 3)), np.zeros((10, 30, 3)))


def _pq(luminance):
    """Inverse EOTF of SMPTE ST 2084, written from the standard."""
    y = (np.asarray(luminance) / 10000) ** (2610 / 16384)
    return ((3424 / 4096 + 2413 / 128 * y) / (1 + 2392 / 128 * y)) ** (2523 / 32)


def _itp(rgb):
    """Linear sRGB, 1 = 100 cd/m2, to (I, T, P): the integer matrices of BT.2100 and the one of BT.2087."""
    rgb_2020 = np.array([[0.6274, 0.3293, 0.0433], [0.0691, 0.9195, 0.0114], [0.0164, 0.0880, 0.8956]]) @ rgb
    lms = np.array([[1688, 2146, 262], [683, 2951, 462], [99, 309, 3688]]) / 4096 @ (100 * rgb_2020)
    i, ct, cp = np.array([[2048, 2048, 0], [6610, -13613, 7003], [17933, -17390, -543]]) / 4096 @ _pq(lms)
    return np.array([i, ct / 2, cp])
