"""Films: as many frames as were given, shown as long as they should be, and what moves is seen to move."""

from __future__ import annotations

import sys

import numpy as np
import pytest

import oneform_warp as ow
from oneform_warp.errors import FileError, InputError
from oneform_warp.movie import check_movie, save_movie

PIL = pytest.importorskip("PIL.Image")
X, FACES = ow.shapes.bar(segments=4, sides=1)
FRAMES = [X, X + [0.2, 0, 0], X + [0.4, 0, 0], X]


def pictures(path):
    film = PIL.open(path)
    for number in range(film.n_frames):
        film.seek(number)
        yield np.asarray(film.convert("RGB")).astype(int), film.info["duration"]


def test_a_gif_shows_each_frame_for_its_time(tmp_path):
    path = tmp_path / "film.gif"
    held, moved = X[:, 2] < 0.1, X[:, 2] > 0.9
    drawn = save_movie(path, FRAMES, FACES, fps=24.0, held=held, moved=moved, size=(121, 100), backend="matplotlib")
    assert drawn == "matplotlib"
    film = list(pictures(path))
    assert PIL.open(path).info["loop"] == 0
    assert [picture.shape for picture, _ in film] == [(100, 122, 3)] * 4
    # 24 in a second are 4, 8, 12 (12.5) and 17 (16.7) hundredths of it.
    assert sum(duration for _, duration in film) == 170
    dark = [np.argwhere(picture.sum(axis=2) < 600)[:, 1].mean() for picture, _ in film]
    first, second = np.diff(dark[:3])
    assert first * second > 0  # to one side, whichever side the camera is on
    assert min(abs(first), abs(second)) > 3
    assert np.abs(film[0][0] - film[3][0]).max() == 0
    colours = {tuple(colour) for picture, _ in film for colour in picture.reshape(-1, 3)}
    assert any(b > r + 60 for r, g, b in colours)  # held
    assert any(r > b + 60 for r, g, b in colours)  # moved
    assert [each.name for each in tmp_path.iterdir()] == ["film.gif"]


def test_polyscope_draws_films_in_batches(tmp_path, monkeypatch):
    seen = []

    def draw(panels, cameras, cell):
        seen.append(len(panels))
        return [np.full((cell[1], cell[0], 3), 10 * i, dtype=np.uint8) for i in range(len(panels))]

    monkeypatch.setattr("oneform_warp.movie.by_polyscope", draw)
    assert save_movie(tmp_path / "a.gif", FRAMES * 8, FACES, size=(20, 20)) == "polyscope"
    assert seen == [24, 8]
    monkeypatch.setattr("oneform_warp.movie.by_polyscope", lambda *_: None)
    assert save_movie(tmp_path / "b.gif", FRAMES, FACES, size=(20, 20)) == "matplotlib"
    with pytest.raises(InputError, match="polyscope cannot draw"):
        save_movie(tmp_path / "c.gif", FRAMES, FACES, backend="polyscope")


def test_an_mp4_has_all_frames(tmp_path):
    ffmpeg = pytest.importorskip("imageio_ffmpeg", reason="imageio-ffmpeg is not installed")
    path = tmp_path / "film.mp4"
    save_movie(path, FRAMES * 3, FACES, fps=12.0, size=(64, 48), backend="matplotlib")
    assert ffmpeg.count_frames_and_secs(str(path)) == (12, 1.0)


def test_without_ffmpeg_an_mp4_is_an_error_that_says_what_to_install(tmp_path, monkeypatch):
    monkeypatch.setitem(sys.modules, "imageio_ffmpeg", None)
    with pytest.raises(FileError, match=r"oneform-warp\[video\]"):
        check_movie(tmp_path / "film.mp4")
    check_movie(tmp_path / "film.gif")


@pytest.mark.parametrize("name", ["film.avi", "film", "none/film.gif"])
def test_films_that_cannot_be_written_are_errors(tmp_path, name):
    with pytest.raises(FileError):
        save_movie(tmp_path / name, FRAMES, FACES)


@pytest.mark.parametrize(
    ("frames", "fps"), [([], 24.0), (FRAMES, 0.0), (FRAMES, np.nan), ([X, X[:3]], 24.0), ([X, X * np.nan], 24.0)]
)
def test_frames_that_make_no_film_are_errors(tmp_path, frames, fps):
    with pytest.raises(InputError):
        save_movie(tmp_path / "film.gif", frames, FACES[:0], fps=fps)
    assert not list(tmp_path.iterdir())
