"""A PLY through a chain against its load and save by MeshLab alone: the price of a deformation in a script.

`python -m bench.chain [--full] [--device cuda:0] [--sizes 10k 100k]`
"""

from __future__ import annotations

import statistics
import tempfile
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from bench.options import Options, options
from bench.table import calm, report

REPEATS = 11
SIDES = 24
TURN = (
    ("set_oneform_handle", {"condselect": "z < zmin + 0.1*(zmax-zmin)", "held": True}),
    ("set_oneform_handle", {"condselect": "z > zmin + 0.9*(zmax-zmin)", "angle": 90}),
    ("apply_coord_oneform_deformation", {}),
)
NATIVE = ("apply_coord_laplacian_smoothing", {"stepsmoothnum": 1})


def write_bar(folder: Path, vertices: int) -> Path:
    """A bar as binary PLY with float32 coordinates."""
    import trimesh

    from oneform_warp import shapes

    x, faces = shapes.bar(segments=max(1, vertices // (4 * SIDES)), sides=SIDES)
    path = folder / f"{vertices}.ply"
    trimesh.Trimesh(x, faces, process=False).export(path)
    return path


def by_meshlab(source: Path, target: Path) -> dict[str, float]:
    """Seconds of MeshLab's load and save, nothing between."""
    import pymeshlab

    meshes, begin = pymeshlab.MeshSet(), time.perf_counter()
    meshes.load_new_mesh(str(source))
    loaded = time.perf_counter()
    meshes.save_current_mesh(str(target))
    return {"load": loaded - begin, "save": time.perf_counter() - loaded}


def medians(works: Mapping[str, Callable[[], dict[str, float]]]) -> dict[str, dict[str, float]]:
    """The median of each stage, and of "all", over warm runs; works take turns, so that others disturb them alike."""
    runs = dict[str, list[dict[str, float]]]((name, []) for name in works)
    for number in range(REPEATS + 1):
        for name, work in works.items():
            begin = time.perf_counter()
            stages = work()
            if number:
                runs[name].append({**stages, "all": time.perf_counter() - begin})
    return {
        name: {stage: statistics.median(run[stage] for run in each) for stage in each[0]} for name, each in runs.items()
    }


def row(vertices: int, folder: Path) -> dict[str, Any]:
    """Of one size: load and save, our chain, and the same with a filter of MeshLab's at the end."""
    from oneform_warp.filters import Chain, Step

    source, target = write_bar(folder, vertices), folder / "out.ply"
    chain = Chain([Step(*step) for step in TURN])
    mixed = Chain([Step(*step) for step in (*TURN, NATIVE)])
    calm()
    found = medians(
        {
            "MeshLab": lambda: by_meshlab(source, target),
            "chain": lambda: dict(chain.process(source, target).seconds),
            "with a native filter": lambda: dict(mixed.process(source, target).seconds),
        }
    )
    alone, ours, native = found.values()
    return {
        "vertices": vertices,
        "load+save s": alone["all"],
        "chain s": ours["all"],
        "chain / load+save": ours["all"] / alone["all"],
        "load": ours["load"],
        "handles": sum(seconds for name, seconds in ours.items() if "handle" in name),
        "deformation": next(seconds for name, seconds in ours.items() if "deformation" in name),
        "save": ours["save"],
        "with a native filter s": native["all"],
        "stages": found,
    }


def main(given: Options) -> None:
    """Prints a row for each size."""
    try:
        import pymeshlab  # noqa: F401
    except ImportError as error:
        print(f"left out: {error}")
        return
    device = given.device
    sizes = given.counts([10_000, 100_000, 1_000_000] if given.full else [10_000, 100_000])
    claim = f"a binary PLY through a chain on {device.name}, against MeshLab's load and save; medians of {REPEATS}"
    with tempfile.TemporaryDirectory() as name:
        rows = [row(vertices, Path(name)) for vertices in sizes]
    report(f"chain-{'cuda' if device.is_cuda else 'cpu'}", claim, rows)


if __name__ == "__main__":
    main(options())
