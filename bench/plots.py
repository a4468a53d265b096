"""Draws one plot for each JSON file in bench/results/ into docs/bench/: `python -m bench.plots`."""

from __future__ import annotations

import json
from collections.abc import Callable
from io import BytesIO
from pathlib import Path
from typing import Any

import matplotlib as mpl

mpl.use("Agg")

import matplotlib.pyplot as plt
from PIL import Image

from bench.table import RESULTS

PLOTS = Path(__file__).parent.parent / "docs" / "bench"
OURS, PEERS = "tab:blue", "0.45"
Rows = list[dict[str, Any]]


def solve(rows: Rows) -> Any:
    """Setup + solve and repeated solve of every method, a panel per mesh of the default weights."""
    rows = [r for r in rows if (r["weights"], r["pins"]) == ("cotangent", "one")]
    meshes = list(dict.fromkeys(r["mesh"] for r in rows))
    figure, panels = plt.subplots(1, len(meshes), figsize=(1.0 + 3.4 * len(meshes), 3.2), squeeze=False)
    for panel, mesh in zip(panels[0], meshes, strict=True):
        lines = sorted((r for r in rows if r["mesh"] == mesh), key=lambda r: -r["both s"])
        for k, row in enumerate(lines):
            colour = OURS if row["method"].startswith("ours") else PEERS
            panel.plot([row["solve s"], row["both s"]], [k, k], color=colour, linewidth=0.8)
            panel.plot(row["both s"], k, "o", color=colour)
            panel.plot(row["solve s"], k, "o", color=colour, markerfacecolor="white")
        panel.set(xscale="log", title=f"{mesh}, {lines[0]['vertices']:,} vertices", xlabel="seconds")
        panel.set_yticks(range(len(lines)), [r["method"] + ("" if r["reached"] == "yes" else " (!)") for r in lines])
    figure.suptitle("● setup + first solve    ○ solve again    (!) error above 1e-6", fontsize=9)
    return figure


def stacked(rows: Rows, stages: list[str], label: Callable[[dict[str, Any]], str]) -> Any:
    """A bar per row, its stages side by side, in microseconds a vertex so that sizes compare."""
    figure, axes = plt.subplots(figsize=(7.0, 0.8 + 0.35 * len(rows)))
    begin = [0.0] * len(rows)
    for stage in stages:
        lengths = [1e6 * r[stage] / r["vertices"] for r in rows]
        axes.barh(range(len(rows)), lengths, left=begin, label=stage.removesuffix(" s"))
        begin = [a + b for a, b in zip(begin, lengths, strict=True)]
    axes.set_yticks(range(len(rows)), [label(r) for r in rows])
    axes.invert_yaxis()
    axes.set_xlabel("microseconds a vertex")
    axes.legend(fontsize=7, loc="center left", bbox_to_anchor=(1.0, 0.5))
    return figure


def edit(rows: Rows) -> Any:
    stages = ["fields", "1-form", "start", "prepare", "solve"]
    return stacked(rows, stages, lambda r: f"{r['edit']}, {r['mesh']}: {1e3 * r['wall']:.3g} ms in all")


def first(rows: Rows) -> Any:
    rows = [r for r in rows if (r["weights"], r["pins"]) == ("cotangent", "one")]
    stages = [column for column in rows[0] if column.endswith(" s")]
    return stacked(rows, stages, lambda r: f"{r['mesh']}, {r['vertices']:,}")


def lines(rows: Rows, columns: list[str], ylabel: str) -> Any:
    """Columns against the number of vertices, both logarithmic."""
    figure, axes = plt.subplots(figsize=(6.0, 3.6))
    rows = sorted(rows, key=lambda r: r["vertices"])
    for column in columns:
        axes.plot([r["vertices"] for r in rows], [r[column] for r in rows], ".-", label=column.removesuffix(" s"))
    axes.set(xscale="log", yscale="log", xlabel="vertices", ylabel=ylabel)
    axes.legend(fontsize=7)
    return figure


def scale(rows: Rows) -> Any:
    figure = lines(rows, ["graph s", "structure s", "prepare s", "first s", "solve s"], "seconds")
    counts = ", ".join(str(r["iterations"]) for r in rows)
    memory = max(r["graph B/vertex"] + r["solver B/vertex"] for r in rows)
    figure.suptitle(f"iterations: {counts}; at most {memory:.0f} bytes a vertex", fontsize=9)
    return figure


def roofline(rows: Rows) -> Any:
    """The share of a copy's bandwidth that each kernel reaches on the largest mesh."""
    largest = max(r["rows"] for r in rows)
    mesh = next(r["mesh"] for r in rows if r["rows"] == largest)
    rows = [r for r in rows if r["mesh"] == mesh]
    figure, axes = plt.subplots(figsize=(6.0, 0.8 + 0.22 * len(rows)))
    axes.barh(range(len(rows)), [r["of copy"] for r in rows], color=OURS)
    axes.set_yticks(range(len(rows)), [f"{r['what']}: {r['us']:.3g} µs" for r in rows], fontsize=7)
    axes.invert_yaxis()
    axes.axvline(0.7, color=PEERS, linewidth=0.8)
    axes.set(xlabel="share of the copy's bandwidth", title=f"{mesh}, {largest:,} vertices")
    return figure


def stages(rows: Rows) -> Any:
    return lines(rows, [c for c in rows[0] if c not in ("vertices", "iterations")], "seconds")


def iteration(rows: Rows) -> Any:
    return lines(rows, ["product us", "iteration us"], "microseconds")


def many(rows: Rows) -> Any:
    return lines(rows, ["one by one/s", "together/s", "again/s"], "meshes a second")


def large(rows: Rows) -> Any:
    return lines(rows, ["graph s", "structure s", "prepare s", "again s"], "seconds")


def survey(rows: Rows) -> Any:
    """ARAP energy, over the least of each case, against time; what stays behind is high."""
    rows = [r for r in rows if "ms" in r]
    names = [name for name in dict.fromkeys(r["case"] for r in rows) if "270" not in name and "720" not in name]
    across = 4
    down = -(-len(names) // across)
    figure, panels = plt.subplots(down, across, figsize=(12.0, 2.6 * down), squeeze=False)
    for panel in panels.ravel()[len(names) :]:
        panel.set_axis_off()
    for panel, name in zip(panels.ravel(), names, strict=False):
        of_case = [r for r in rows if r["case"] == name]
        least = min(r["ARAP"] for r in of_case)
        for kind, colour in (("ours", OURS), ("libigl", PEERS), ("Open3D", "tab:orange")):
            line = sorted((r for r in of_case if r["method"].startswith(kind)), key=lambda r: r["ms"])
            panel.plot([r["ms"] for r in line], [r["ARAP"] / least for r in line], ".-", color=colour, label=kind)
        panel.set(xscale="log", title=name, xlabel="ms", ylabel="ARAP / least")
        panel.title.set_fontsize(9)
    panels[0, 0].legend(fontsize=7)
    return figure


def arap(rows: Rows) -> Any:
    columns = ["ours ms", *(["libigl ms"] if all(isinstance(r["libigl ms"], float) for r in rows) else [])]
    return lines(rows, columns, "milliseconds a step")


DRAW = {f.__name__: f for f in (solve, edit, first, scale, large, many, roofline, stages, iteration, survey, arap)}


def main() -> None:
    PLOTS.mkdir(parents=True, exist_ok=True)
    for path in sorted(RESULTS.glob("*.json")):
        draw = DRAW.get(path.stem.split("-")[0])
        results = json.loads(path.read_text())
        if draw is None or not results["rows"]:
            continue
        figure = draw(results["rows"])
        figure.text(0.99, 0.01, results["device"], ha="right", fontsize=6, color=PEERS)
        figure.tight_layout()
        keep_small(figure, PLOTS / f"{path.stem}.png")
        plt.close(figure)
        print(f"docs/bench/{path.stem}.png")


def keep_small(figure: Any, path: Path) -> None:
    """As a PNG with a palette: half of the bytes, and no difference to the eye."""
    picture = BytesIO()
    figure.savefig(picture, dpi=90)
    Image.open(picture).convert("RGB").quantize(256, method=Image.Quantize.FASTOCTREE).save(path, optimize=True)


if __name__ == "__main__":
    main()
