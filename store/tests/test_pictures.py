"""The scripts that draw the pictures of the store still read what a run records."""

import numpy as np
import pytest
from support.runs.store import store
from support.store_paths import STORE_TESTS


@pytest.mark.slow
def test_a_frame_of_the_film_shows_the_store(tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(STORE_TESTS.parent / "scripts")
    import store_movie  # noqa: PLC0415

    log = store_movie.Log(store(tmp_path).recording)
    film = store_movie.shots(log, log.moments())
    scene = store_movie.Scene(log, tmp_path / "world")
    scene.show(film[1].start)
    picture = store_movie.draw(scene, film[1].look)
    assert [shot.start for shot in film[1:]] == [shot.end for shot in film[:-1]]
    assert picture.shape == (360, 640, 3)
    assert len(np.unique(picture.reshape(-1, 3), axis=0)) > 100
