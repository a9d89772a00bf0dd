"""Image metrics that are reported: SSIM and Delta E_ITP as in the paper, PSNR and the log difference beside them.

All take linear RGB radiance as rendered, float arrays of shape (H, W, 3), and average over every pixel of the image,
background included. The paper names its two metrics but neither range, exposure nor scale, so absolute numbers are
comparable inside this project only; order and ratios between models are what to read from them.
"""

from __future__ import annotations

import numpy as np

from ..fitting.losses import log_l1
from ..output.srgb import encode_srgb

WHITE_CD_M2 = 100.0  # luminance given to radiance 1: the peak white of a standard-dynamic-range display
JND_PER_ITP = 720.0  # ITU-R BT.2124: 720 times the distance in ITP is 1 at the threshold of visibility


def ssim(image, truth):
    """Structural similarity of two renders as a viewer sees them: clipped to [0, 1] and sRGB encoded.

    Parameters
    ----------
    image, truth : array (H, W, 3)
        Linear RGB radiance, at least 11 pixels wide and high.

    Returns
    -------
    float
        Mean over pixels and channels, at most 1; 1 for equal images.

    Raises
    ------
    ValueError
        If shapes differ, are not (H, W, 3) or too small, or if a value is not finite.

    Notes
    -----
    Gaussian window of sigma 1.5, population covariance, K1 = 0.01, K2 = 0.03: the settings of the original.

    References
    ----------
    Wang et al. 2004, "Image quality assessment: from error visibility to structural similarity", section III.

    Examples
    --------
    >>> ssim(np.full((16, 16, 3), 0.5), np.full((16, 16, 3), 0.5))
    1.0
    """
    from skimage.metrics import structural_similarity

    image, truth = _check("ssim", image, truth)
    if min(image.shape[:2]) < 11:
        raise ValueError(
            f"ssim(): image of {image.shape[0]} x {image.shape[1]} pixels; the window needs at least 11 x 11. "
            "Render at a higher resolution."
        )
    return float(
        structural_similarity(
            encode_srgb(truth),
            encode_srgb(image),
            channel_axis=2,
            data_range=1.0,
            gaussian_weights=True,
            sigma=1.5,
            use_sample_covariance=False,
        )
    )


def delta_E_ITP_map(image, truth):
    """Colour difference of each pixel: Euclidean distance in the ITP space of ITU-R BT.2100 (PQ).

    Parameters
    ----------
    image, truth : array (H, W, 3)
        Linear RGB radiance with sRGB primaries. Values below 0 (measured colours outside the gamut) count as 0, since
        no display shows them; nothing is clipped above 1, since the metric is made for high dynamic range.

    Returns
    -------
    array (H, W)
        Distance in ITP, at least 0, WITHOUT the factor 720 of BT.2124: ``720 * delta_E_ITP_map`` is in just
        noticeable differences.

    Notes
    -----
    PQ is absolute, so radiance needs a luminance: 1.0 is taken as 100 cd/m2 (``WHITE_CD_M2``), the white of a
    standard display, which is how the renders are looked at. The factor 720 is left out because Kavoosighafi et al.,
    whom the paper cites, speak of "a simple Euclidean distance in the ITP color space", and because the paper's
    figures after multiplication by 1000 lie where such a distance does; with 720 they would all be far below one
    just noticeable difference.

    References
    ----------
    ITU-R BT.2124-0 (2019); Kavoosighafi et al. 2025, "Perceived Quality of BRDF Models".
    """
    import colour

    image, truth = _check("delta_E_ITP_map", image, truth)

    def ictcp(rgb):
        rgb_2020 = colour.RGB_to_RGB(np.maximum(rgb, 0), "sRGB", "ITU-R BT.2020")
        return colour.RGB_to_ICtCp(rgb_2020 * WHITE_CD_M2)

    return colour.delta_E(ictcp(image), ictcp(truth), method="ITP") / JND_PER_ITP


def delta_E_ITP(image, truth):
    """Mean over all pixels of `delta_E_ITP_map`. Reports multiply it by 1000, as the paper does.

    Examples
    --------
    >>> delta_E_ITP(np.full((2, 2, 3), 0.5), np.full((2, 2, 3), 0.5))
    0.0
    """
    return float(np.mean(delta_E_ITP_map(image, truth)))


def psnr(image, truth):
    """Peak signal-to-noise ratio in dB of the clipped, sRGB encoded images; infinite for equal ones.

    Examples
    --------
    >>> round(psnr(np.zeros((4, 4, 3)), np.ones((4, 4, 3))), 6)
    0.0
    """
    from skimage.metrics import peak_signal_noise_ratio

    image, truth = _check("psnr", image, truth)
    with np.errstate(divide="ignore"):  # equal images: log of 1/0 is the wanted infinity
        return float(peak_signal_noise_ratio(encode_srgb(truth), encode_srgb(image), data_range=1.0))


def mean_abs_log(image, truth):
    """Mean of abs(log(1 + truth) - log(1 + image)), linear, negative radiance as 0: the fitting loss on an image.

    Examples
    --------
    >>> round(mean_abs_log(np.zeros((4, 4, 3)), np.full((4, 4, 3), np.e - 1)), 6)
    1.0
    """
    image, truth = _check("mean_abs_log", image, truth)
    return log_l1(np.maximum(image, 0), np.maximum(truth, 0), 1.0)


def _check(where, image, truth):
    """Both images as float64 (skimage loses digits in float32), or a clear error."""
    image, truth = np.asarray(image, np.float64), np.asarray(truth, np.float64)
    if image.shape != truth.shape or image.ndim != 3 or image.shape[2] != 3:
        raise ValueError(
            f"{where}(): images of shape {image.shape} and {truth.shape}; both must have the same shape (H, W, 3). "
            "Render both with the same scene and resolution."
        )
    for name, values in (("image", image), ("truth", truth)):
        bad = np.count_nonzero(~np.isfinite(values))
        if bad:
            raise ValueError(
                f"{where}(): {name} holds {bad} values that are NaN or infinite; all must be finite. "
                "Find the material that returns them, e.g. by rendering it alone."
            )
    return image, truth
