"""A batch against a bare loop of the same chain in as many processes; many small files, one by one and together.

python -m bench.batch [--files 200] [--vertices 20000] [--small 1000] [--small-vertices 2000] [--jobs 2]

Small files are also timed with `together`, which on a GPU solves them as one graph; the bytes have to be the same. The
memory of the parent is read after each of them.
"""

from __future__ import annotations

import argparse
import resource
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
import psutil

RECIPE = Path(__file__).resolve().parents[1] / "recipes" / "turn-top.toml"

LOOP = """
import sys
from pathlib import Path
from oneform_warp.filters.recipe import read_recipe
chain = read_recipe(sys.argv[1]).chain()
for source in sys.argv[3:]:
    chain.process(source, Path(sys.argv[2]) / Path(source).name)
"""


class ParentMemory:
    """Resident bytes of this process after each file."""

    def __init__(self) -> None:
        self.bytes: list[int] = []

    def planned(self, total: int, kept: int) -> None:
        """Nothing to note."""

    def finished(self, entry: object) -> None:
        """One file more."""
        self.bytes.append(psutil.Process().memory_info().rss)


def write_files(folder: Path, count: int, vertices: int) -> list[Path]:
    """Bars, each with another lean, as binary PLY."""
    import trimesh

    from oneform_warp import shapes

    sides = 24
    x, faces = shapes.bar(segments=max(1, vertices // (4 * sides)), sides=sides)
    folder.mkdir()
    paths = [folder / f"{number:04}.ply" for number in range(count)]
    for number, path in enumerate(paths):
        lean = np.outer(x[:, 2], [0.2 * number / count, 0.0, 0.0])
        trimesh.Trimesh(x + lean, faces, process=False).export(path)
    return paths


def loop(paths: list[Path], out: Path, processes: int) -> float:
    """Seconds of a bare loop in processes that share the files out."""
    out.mkdir()
    begin = time.perf_counter()
    shares = [paths[number::processes] for number in range(processes)]
    running = [
        subprocess.Popen([sys.executable, "-c", LOOP, str(RECIPE), str(out), *map(str, share)]) for share in shares
    ]
    for each in running:
        if each.wait():
            raise SystemExit("the bare loop failed")
    return time.perf_counter() - begin


def cpu_seconds() -> float:
    """Of this process and of all its children that have ended."""
    return sum(
        usage.ru_utime + usage.ru_stime
        for usage in map(resource.getrusage, (resource.RUSAGE_SELF, resource.RUSAGE_CHILDREN))
    )


def batch(folder: Path, out: Path, workers: int, together: int | None = None) -> tuple[float, list[int]]:
    """Seconds of a batch, and the memory of this process after each file."""
    from oneform_warp.filters.batch import run_batch

    memory = ParentMemory()
    begin = time.perf_counter()
    result = run_batch(RECIPE, [folder], out, name="{name}{ext}", jobs=workers, together=together, progress=memory)
    if result.exit_code:
        raise SystemExit(str(result.failures[0]))
    return time.perf_counter() - begin, memory.bytes


def main() -> None:
    """Prints both."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--files", type=int, default=200)
    parser.add_argument("--vertices", type=int, default=20_000)
    parser.add_argument("--small", type=int, default=1000, help="how many small files; 0 for none")
    parser.add_argument("--small-vertices", type=int, default=500)
    parser.add_argument("--jobs", type=int, default=2, help="workers for the small files")
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as name:
        here = Path(name)
        paths = write_files(here / "in", given.files, given.vertices) if given.files else []
        if given.files:
            print(f"{given.files} files of {given.vertices:,} vertices: wall seconds (processor seconds)")
            against_a_loop(here, paths)
        if given.small:
            write_files(here / "small", given.small, given.small_vertices)
            small_files(here, given.small, given.jobs)


def against_a_loop(here: Path, paths: list[Path]) -> None:
    """Both, with one process and with two."""
    for workers in (1, 2):
        marks = [cpu_seconds()]
        bare = loop(paths, here / "bare", workers)
        marks.append(cpu_seconds())
        ours, _ = batch(here / "in", here / "out", workers)
        marks.append(cpu_seconds())
        busy = np.diff(marks)
        told = f"loop {bare:.1f} ({busy[0]:.1f}), batch {ours:.1f} ({busy[1]:.1f})"
        ratios = f"{ours / bare:.3f} ({busy[1] / busy[0]:.3f})"
        print(f"  {workers} process(es): {told}, ratio {ratios}", flush=True)
        check_same(here / "bare", here / "out")
        shutil.rmtree(here / "bare")
        shutil.rmtree(here / "out")


def small_files(here: Path, count: int, workers: int) -> None:
    """One by one and together, and what the parent needs meanwhile."""
    batch(here / "small", here / "first", workers, 1)  # compiles
    seconds, rss = batch(here / "small", here / "apart", workers, 1)
    marks = sorted({0, count // 10, count // 2, count - 1})
    told = ", ".join(f"{rss[mark] / 1e6:.1f} after {mark + 1}" for mark in marks)
    print(f"{count} small files, {workers} workers: {seconds:.1f} s one by one, MB of the parent: {told}", flush=True)
    together, _ = batch(here / "small", here / "together", workers, 128)
    check_same(here / "apart", here / "together")
    print(f"  {together:.1f} s together ({seconds / together:.2f} times as fast), the same bytes")


def check_same(one: Path, other: Path) -> None:
    """End with the name of a file that differs."""
    for path in sorted(one.glob("*.ply")):
        if path.read_bytes() != (other / path.name).read_bytes():
            raise SystemExit(f"{path.name} differs")


if __name__ == "__main__":
    main()
