"""Pictures: written as PNG without a window, with both poses at the same scale and the marks in colour."""

import numpy as np
import pytest

from oneform_warp.errors import FileError, InputError
from oneform_warp.preview import save_preview, save_scene


def grid(n=9):
    """A tall plane of quads in x and y, (V, 3) and (F, 4)."""
    x, y = np.meshgrid(np.arange(n), np.arange(2 * n), indexing="ij")
    ids = np.arange(x.size).reshape(x.shape)
    faces = np.stack([ids[:-1, :-1], ids[1:, :-1], ids[1:, 1:], ids[:-1, 1:]], axis=-1).reshape(-1, 4)
    return np.stack([x.ravel(), y.ravel(), 0 * x.ravel()], axis=1).astype(float), faces


def pixels(path):
    from matplotlib.image import imread

    return imread(path)[..., :3]


@pytest.fixture(params=["matplotlib", "polyscope"])
def backend(request, tmp_path):
    if request.param == "polyscope":
        try:
            save_scene(tmp_path / "probe.png", [("", *grid(2))], backend="polyscope")
        except InputError:
            pytest.skip("polyscope cannot draw here")
    return request.param


def test_preview_shows_both_poses_and_the_marks(tmp_path, backend):
    x, faces = grid()
    path = tmp_path / "a.png"
    held, moved = x[:, 1] < 4, np.flatnonzero(x[:, 1] > 13)
    used = save_preview(path, x, x * [1, 0.5, 1], faces, held=held, moved=moved, size=(800, 400), backend=backend)
    picture = pixels(path)
    assert used == backend
    assert picture.shape == (400, 800, 3)
    red, blue = picture[..., 0], picture[..., 2]
    left, right = slice(0, 400), slice(400, 800)
    for half in (left, right):
        assert (blue - red)[:, half].max() > 0.15
        assert (red - blue)[:, half].max() > 0.2
    # The blue rows are at the bottom: up is y.
    rows = np.arange(400)[:, None]
    blues, reds = (blue - red > 0.15)[:, left], (red - blue > 0.2)[:, left]
    assert (blues * rows).sum() / blues.sum() > (reds * rows).sum() / reds.sum() + 100
    # The squeezed pose is half as tall, because the scale is the same.
    heights = [np.ptp(np.flatnonzero((picture[40:, half] < 0.95).any(axis=(1, 2)))) for half in (left, right)]
    assert heights[1] == pytest.approx(heights[0] / 2, rel=0.1)


def test_scene_takes_polygons_points_planes_and_scalars(tmp_path, backend):
    x, faces = grid(5)
    mixed = np.array([0, 1, 10, 1, 11, 12, 10]), np.array([0, 3, 7])
    items = [
        ("scalar", x, faces, x[:, 1]),
        ("polygons", x, mixed),
        ("plane", x[:, :2], faces, None),
        ("points", x, np.zeros((0, 3), dtype=int)),
    ]
    save_scene(tmp_path / "a.png", items, columns=2, size=(600, 600), backend=backend, title="four")
    picture = pixels(tmp_path / "a.png")
    assert picture.shape == (600, 600, 3)
    for rows in (slice(60, 300), slice(340, 600)):
        for columns in (slice(0, 300), slice(300, 600)):
            assert picture[rows, columns].min() < 0.9


def test_auto_falls_back_when_polyscope_fails(tmp_path, monkeypatch):
    monkeypatch.setattr("oneform_warp.preview.by_polyscope", lambda *_: None)
    x, faces = grid(3)
    assert save_preview(tmp_path / "a.png", x, x, faces) == "matplotlib"
    with pytest.raises(InputError, match="polyscope cannot draw here"):
        save_preview(tmp_path / "b.png", x, x, faces, backend="polyscope")


def test_input_that_cannot_be_drawn(tmp_path):
    x, faces = grid(3)
    with pytest.raises(InputError, match="deformed: positions are not finite"):
        save_preview(tmp_path / "a.png", x, x * np.nan, faces)
    with pytest.raises(InputError, match="differ"):
        save_preview(tmp_path / "a.png", x, x[:-1], faces)
    with pytest.raises(FileError, match=r"a\.jpg: a picture is a \.png"):
        save_preview(tmp_path / "a.jpg", x, x, faces)
    with pytest.raises(InputError, match="nothing to draw"):
        save_scene(tmp_path / "a.png", [])
    assert list(tmp_path.iterdir()) == []
