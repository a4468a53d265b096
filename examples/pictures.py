"""What the examples print and draw: their numbers, and rows of panels without the white between them."""

from __future__ import annotations

import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from oneform_warp.preview import save_scene

CAPTION = 34
"""The height in pixels that `save_scene` keeps for a caption."""


def figure_folder() -> Path:
    """The folder named on the command line, else figures/; made where it is missing."""
    folder = Path(sys.argv[1] if len(sys.argv) > 1 else "figures")
    folder.mkdir(parents=True, exist_ok=True)
    return folder


def report(numbers: dict[str, float]) -> None:
    """Print numbers, one on a line."""
    for name, value in numbers.items():
        print(f"  {value:12.4g}  {name}")


def save_row(path: Path, items: Sequence[Any], *, height: int = 480, gap: int = 24) -> None:
    """Draw items as `save_scene` does, at one scale and in one row, and cut each panel to what is in it."""
    from matplotlib.font_manager import findfont
    from PIL import Image, ImageDraw, ImageFont

    count, captions = len(items), [item[0] for item in items]
    size = (height * count, height + CAPTION)
    save_scene(path, [("", *item[1:]) for item in items], columns=count, size=size, shared_camera=True)
    picture = np.asarray(Image.open(path).convert("RGB"))
    panels = np.split(picture, count, axis=1)
    parts = [panel[:, _span((panel < 250).any(axis=(0, 2)), gap)] for panel in panels]
    row = np.concatenate(parts, axis=1)
    row = row[_span((row < 250).any(axis=(1, 2)), 6)]
    sheet = Image.new("RGB", (row.shape[1], row.shape[0] + CAPTION), "white")
    sheet.paste(Image.fromarray(row), (0, CAPTION))
    font = ImageFont.truetype(findfont("DejaVu Sans"), 18)
    ends = np.cumsum([part.shape[1] for part in parts])
    for caption, part, end in zip(captions, parts, ends, strict=True):
        middle = (end - part.shape[1] / 2, CAPTION / 2)
        ImageDraw.Draw(sheet).text(middle, caption, "#404040", font, anchor="mm")
    sheet.save(path, optimize=True)


def _span(used: Any, margin: int) -> slice:
    """From the first to the last true entry, with a margin."""
    where = np.flatnonzero(used)
    return slice(max(where[0] - margin, 0), where[-1] + margin)
