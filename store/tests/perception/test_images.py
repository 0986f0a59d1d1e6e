"""The arithmetic of images."""

import numpy as np
import pytest

from stepbus_store.perception.images import median


@pytest.mark.parametrize("count", [1, 2, 3, 4, 11, 100])
def test_the_median_is_that_of_numpy_to_the_bit(count):
    values = np.random.default_rng(count).normal(size=count)
    assert median(values) == np.median(values)
