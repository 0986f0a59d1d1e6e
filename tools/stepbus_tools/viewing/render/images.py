"""Camera images as pixels."""

import numpy as np

from stepbus_schemas import Image

from .raster import Pixels


def pixels_of(image: Image) -> Pixels:
    """Return an image in colours, shape (height, width, 3); a depth in grey, near is light.

    Raises ValueError where its bytes do not fit its size.
    """
    size = (image.height, image.width)
    if image.encoding == "rgb8":
        return np.frombuffer(image.data, np.uint8).reshape(*size, 3)
    meters = np.frombuffer(image.data, "<f4").reshape(size)
    far = float(np.max(meters, initial=0.0, where=np.isfinite(meters))) or 1.0
    near = np.clip(1 - np.nan_to_num(meters, nan=far, posinf=far) / far, 0, 1)
    return np.repeat((255 * near).astype(np.uint8)[:, :, None], 3, axis=2)
