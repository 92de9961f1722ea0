import numpy as np
import pytest
from PIL import Image

torch = pytest.importorskip("torch", reason="PyTorch is not installed")

from vioapr.errors import ParameterError  # noqa: E402
from vioapr.export.preprocess import Preprocessor  # noqa: E402
from vioapr.schemas.regressor import IMAGE_MEAN, IMAGE_STD  # noqa: E402


def picture(height, width, rng):
    coarse = rng.integers(0, 256, (max(height // 7, 1), max(width // 7, 1), 3), dtype=np.uint8)
    smooth = np.asarray(Image.fromarray(coarse).resize((width, height)), dtype=int)
    return np.clip(smooth + rng.integers(-20, 20, smooth.shape), 0, 255).astype(np.uint8)


@pytest.mark.parametrize(
    "size", [(480, 640), (1080, 1920), (192, 256), (100, 57), (256, 256), (300, 1000), (5, 3)]
)
def test_it_resizes_as_pil_does_within_a_grey_level(rng, size):
    image = picture(*size, rng)
    resized = Image.fromarray(image).resize((256, 256), Image.Resampling.BILINEAR)
    expected = np.asarray(resized, dtype=float)[16:240, 16:240]
    output = Preprocessor(256, 224)(torch.from_numpy(image))
    assert output.shape == (1, 3, 224, 224)
    grey = 255 * (output[0].permute(1, 2, 0).numpy() * np.array(IMAGE_STD) + IMAGE_MEAN)
    assert np.abs(grey - expected).max() <= 1.0


def test_a_grey_picture_stays_as_it_is():
    image = np.full((50, 70, 3), 51, dtype=np.uint8)
    output = Preprocessor(64, 56)(torch.from_numpy(image))
    expected = (0.2 - np.array(IMAGE_MEAN)) / np.array(IMAGE_STD)
    np.testing.assert_allclose(output[0, :, 0, 0], expected, atol=1e-5)
    np.testing.assert_allclose(output[0, :, -1, -1], expected, atol=1e-5)


def test_one_pixel_is_an_image():
    output = Preprocessor(64, 56)(torch.zeros((1, 1, 3), dtype=torch.uint8))
    assert torch.isfinite(output).all()


def test_a_crop_larger_than_the_square_is_refused():
    with pytest.raises(ParameterError, match="crop of 1 to 64"):
        Preprocessor(64, 65)
