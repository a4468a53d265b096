"""Draws the standard cases by ours and by libigl into docs/pictures/survey.png: `python -m bench.survey_pictures`."""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import warp as wp
from numpy.typing import NDArray
from PIL import Image

from bench.arap_methods import libigl, ours
from bench.survey_cases import MESHES, SurveyCase, cases
from oneform_warp.preview import save_scene

PICTURE = Path(__file__).parent.parent / "docs" / "pictures" / "survey.png"
CELL = (230, 250)
"""Pixels of a panel."""

LEFT_OUT = ("CGAL", "135", "armadillo 26k, bent by 60", "horse 48k, bent by 90")
ROWS: dict[str, Callable[[SurveyCase], NDArray[np.float64]]] = {
    "rest": lambda case: case.x,
    "ours, one solve": ours(0).run,
    "ours, + 10 steps": ours(10).run,
    "libigl, 10 steps": libigl(10).run,
    "libigl, 100 steps": libigl(100).run,
}


def column(case: SurveyCase) -> Any:
    """All methods on one case, one below the other, at one scale; handles have other colours."""
    mark = np.zeros(len(case.x))
    mark[case.fixed], mark[case.moved] = -1.0, 1.0
    items = []
    for k, (name, run) in enumerate(ROWS.items()):
        caption = f"{case.name.replace(' 26k', '').replace(' 48k', '')}" if k == 0 else name
        items.append((caption, run(case), case.faces, mark))
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "column.png"
        save_scene(path, items, columns=1, shared_camera=True, size=(CELL[0], CELL[1] * len(items)))
        return np.asarray(Image.open(path).convert("RGB"))


def main() -> None:
    if not MESHES.is_dir():
        print("bench.survey_pictures: the real meshes are not here, set ONEFORM_MESHES to their folder")
        return
    wp.config.log_level = wp.LOG_WARNING
    chosen = [case for case in cases(full=True) if not any(word in case.name for word in LEFT_OUT)]
    sheet = Image.fromarray(np.concatenate([column(case) for case in chosen], axis=1))
    sheet.quantize(256, method=Image.Quantize.FASTOCTREE).save(PICTURE, optimize=True)
    print(PICTURE)


if __name__ == "__main__":
    main()
