"""Small files solved together: the same bytes as one by one, and every failure is that of its own file."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("pebble")
pytest.importorskip("pymeshlab")

import oneform_warp as ow
from oneform_warp.filters.batch import bundle, run_batch
from oneform_warp.filters.batch.bundle import run_together, work_together
from oneform_warp.filters.batch.work import Failure, Job, Made, work
from oneform_warp.filters.handle_set import HandleSet, Settings
from oneform_warp.filters.recipe import read_recipe

TOP = "z > zmin + 0.9*(zmax-zmin)"


def recipe(solver: str = "cg", after: str = "", condition: str = TOP) -> str:
    """A foot that is held, a top that is turned and stretched."""
    return f"""
[[steps]]
filter = "set_oneform_handle"
condselect = "z < zmin + 0.1*(zmax-zmin)"
held = true

[[steps]]
filter = "set_oneform_handle"
condselect = "{condition}"
angle = 70
stretch = 1.2

[[steps]]
filter = "apply_coord_oneform_deformation"
solver = "{solver}"
{after}
"""


SMOOTH = '[[steps]]\nfilter = "apply_coord_laplacian_smoothing"\n'
CONSTRAINT = """
[[steps]]
filter = "set_oneform_constraint"
kind = "centroid"
condselect = "z > zmin + 0.4*(zmax-zmin) && z < zmin + 0.6*(zmax-zmin)"
"""
AGAIN = '[[steps]]\nfilter = "apply_coord_oneform_deformation"\nsolver = "cg"\nweights = "uniform"\n'
FIELD = '[[steps]]\nfilter = "compute_scalar_oneform_field"\nfield = "energy density"\n'


def write_mesh(path: Path, seed: int) -> Path:
    """A bar of some size and shape: binary PLY with normals, or OBJ."""
    rng = np.random.default_rng(seed)
    x, faces = ow.shapes.bar(segments=int(rng.integers(6, 20)), sides=int(rng.integers(2, 5)))
    x = 10.0 ** rng.integers(-2, 3) * (x + 0.05 * np.outer(x[:, 2], rng.normal(size=3)))
    if path.suffix == ".obj":
        rows = [f"v {a!r} {b!r} {c!r}" for a, b, c in x.tolist()]
        path.write_text("\n".join([*rows, *("f {} {} {}".format(*face) for face in faces + 1), ""]))
        return path
    normals = rng.normal(size=x.shape)
    header = ["ply", "format binary_little_endian 1.0", f"element vertex {len(x)}"]
    header += [f"property float {name}" for name in ("x", "y", "z", "nx", "ny", "nz")]
    header += [f"element face {len(faces)}", "property list uchar int vertex_indices", "end_header", ""]
    body = b"".join(b"\3" + face.astype("<i4").tobytes() for face in faces)
    path.write_bytes("\n".join(header).encode() + np.hstack([x, normals]).astype("<f4").tobytes() + body)
    return path


def jobs_of(folder: Path, text: str, names: Iterable[str]) -> tuple[Job, ...]:
    """Jobs on files that are there or are written now, with room to work."""
    path = folder / "recipe.toml"
    path.write_text(text)
    made = read_recipe(path)
    (folder / "scratch").mkdir(exist_ok=True)
    sources = [folder / name for name in names]
    for seed, source in enumerate(sources):
        if not source.exists():
            write_mesh(source, seed)
    return tuple(Job(n, source, source.name, folder / "scratch", made) for n, source in enumerate(sources))


NAMES = ("a.ply", "b.obj", "c.ply", "d.ply")


def contents(made: Made | Failure) -> dict[str, bytes]:
    assert isinstance(made, Made), made
    return {name: (made.part / name).read_bytes() for name in made.files}


@pytest.fixture
def alone(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """The numbers of vertices of the meshes that are deformed alone, from now on."""
    sizes: list[int] = []
    solve = ow.Deformer.solve

    def counted(self: ow.Deformer, *arguments: Any, **options: Any) -> Any:
        if type(self) is ow.Deformer:
            sizes.append(self.graph.vertex_count)
        return solve(self, *arguments, **options)

    monkeypatch.setattr(ow.Deformer, "solve", counted)
    return sizes


# ------------------------------------------------------------------ the same bytes


@pytest.mark.parametrize(
    ("after", "left"), [("", 0), (SMOOTH, 0), (AGAIN, 4), (FIELD, 4)], ids=["last", "native", "twice", "field"]
)
def test_a_bundle_gives_the_bytes_of_each_alone(tmp_path: Path, alone: list[int], after: str, left: int) -> None:
    jobs = jobs_of(tmp_path, recipe(after=after), NAMES)
    wanted = [contents(work(job)) for job in jobs]
    alone.clear()
    made = work_together(jobs)
    assert [contents(each) for each in made] == wanted
    assert len(alone) == left
    for one, other in zip(made, map(work, jobs), strict=True):
        assert isinstance(one, Made)
        assert isinstance(other, Made)
        assert one.report.energy == pytest.approx(other.report.energy, rel=1e-9)  # summed in another order
        assert one.report.converged
        assert one.report.residual is not None
        assert one.report.residual <= 1.0
        assert one.report.warnings == other.report.warnings == ()


def test_steps_between_the_handles_and_the_deformation_count(tmp_path: Path, alone: list[int]) -> None:
    before, last = recipe().rsplit("[[steps]]", 1)
    jobs = jobs_of(tmp_path, f"{before}{SMOOTH}\n[[steps]]{last}", NAMES)
    wanted = [contents(work(job)) for job in jobs]
    alone.clear()
    assert [contents(each) for each in work_together(jobs)] == wanted
    assert alone == []


def test_a_batch_gives_the_same_bytes_in_bundles(tmp_path: Path) -> None:
    (tmp_path / "scans").mkdir()
    for seed in range(5):
        write_mesh(tmp_path / "scans" / f"{seed}.ply", seed)
    (tmp_path / "turn.toml").write_text(recipe())
    found = []
    for together in (1, 3):
        out = tmp_path / f"out{together}"
        result = run_batch(tmp_path / "turn.toml", [tmp_path / "scans"], out, jobs=1, together=together)
        assert (result.written, result.failures) == (5, ())
        found.append({path.name: path.read_bytes() for path in out.rglob("*.ply")})
    assert len(found[0]) == 5
    assert found[0] == found[1]


# ------------------------------------------------------------------ who joins


@pytest.mark.parametrize(
    "text",
    [
        recipe(solver="multigrid"),
        recipe(solver="cg") + 'smoothing = "sweeps"\nsweeps = 5',
        recipe(solver="cg") + 'weld = true\nwelddistance = "1%"',
        recipe(solver="cg") + 'weights = "inverse_length"',
        recipe(solver="cg") + "refine = 2",
        recipe(solver="superlu"),
        recipe(solver="cg") + "struts = 0.3",
        recipe(solver="cg") + "t = 0.5",
        recipe(solver="cg").replace("stretch = 1.2", "move = [0, 0, 0.1]"),
        recipe(solver="cg").replace("stretch = 1.2", "stretchfactors = [1.2, 1.0, 1.0]"),
        CONSTRAINT + recipe(solver="cg"),
    ],
    ids=[
        *("multigrid", "sweeps", "weld", "inverse length", "refine", "superlu"),
        *("struts", "part of the way", "move", "stretch factors", "constraint"),
    ],
)
def test_what_is_not_the_same_together_is_deformed_alone(tmp_path: Path, alone: list[int], text: str) -> None:
    made = work_together(jobs_of(tmp_path, text, NAMES))
    assert [each for each in made if isinstance(each, Failure)] == []
    assert len(alone) == len(NAMES)


def test_on_a_cpu_the_choice_of_the_solver_keeps_meshes_apart() -> None:
    x, faces = ow.shapes.bar()
    placed = HandleSet(x, faces)
    assert bundle.foresee([placed, placed], Settings(device="cpu")) == 0


def test_a_warning_is_that_of_the_mesh_alone(tmp_path: Path, alone: list[int]) -> None:
    x, faces = ow.shapes.bar(segments=2, sides=2)
    two = np.concatenate([x, x + [3.0, 0.0, 0.0]])
    turned = recipe(condition="x > 2").replace("z < zmin + 0.1*(zmax-zmin)", "x > 2 && z < 0.01")
    turned = turned.replace('condselect = "x > 2"', 'condselect = "x > 2 && z > 0.1"')
    rows = [f"v {a!r} {b!r} {c!r}" for a, b, c in two.tolist()]
    both = np.concatenate([faces, faces + len(x)]) + 1
    (tmp_path / "two.obj").write_text("\n".join([*rows, *("f {} {} {}".format(*face) for face in both), ""]))
    jobs = jobs_of(tmp_path, turned, ["two.obj", "two.obj"])
    made = work_together(jobs)
    assert len(alone) == 2
    for one, other in zip(made, map(work, jobs), strict=True):
        assert isinstance(one, Made)
        assert isinstance(other, Made)
        assert one.report.warnings == other.report.warnings
        assert any("no handle touches 1 of 2 components" in text for text in one.report.warnings)


# ------------------------------------------------------------------ failures


def test_a_broken_file_costs_only_itself(tmp_path: Path, alone: list[int]) -> None:
    jobs_of(tmp_path, recipe(), NAMES)
    (tmp_path / "cut.ply").write_bytes((tmp_path / "a.ply").read_bytes()[:-30])
    (tmp_path / "flat.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    jobs = jobs_of(tmp_path, recipe(), ["a.ply", "cut.ply", "flat.obj", "c.ply", "gone.ply"])
    jobs[4].source.unlink()
    made = work_together(jobs)
    assert [type(each) for each in made] == [Made, Failure, Failure, Made, Failure]
    assert alone == []
    for one, job in zip(made, jobs, strict=True):
        again = work(job)
        if isinstance(one, Failure):
            assert one == again
        else:
            assert contents(one) == contents(again)


def test_when_solving_together_fails_each_is_solved_alone(
    tmp_path: Path, alone: list[int], monkeypatch: pytest.MonkeyPatch
) -> None:
    def no_memory(*_: object) -> None:
        raise RuntimeError("out of memory")

    monkeypatch.setattr("oneform_warp.filters.together._deformed", no_memory)
    made = work_together(jobs_of(tmp_path, recipe(), NAMES))
    assert all(isinstance(each, Made) for each in made)
    assert len(alone) == len(NAMES)


class LosingPool:
    """A pool whose worker dies of every bundle that has one file in it."""

    def __init__(self, deadly: Path) -> None:
        self.deadly, self.sizes = deadly, list[int]()

    def run(self, function: Callable[[Any], Any], items: Iterable[Any]) -> Iterator[list[tuple[Any, Any]]]:
        for item in items:
            each = item if isinstance(item, tuple) else (item,)
            self.sizes.append(len(each))
            dies = self.deadly in [job.source for job in each]
            yield [(item, Failure("its worker process ended") if dies else function(item))]


def test_a_bundle_that_takes_its_worker_down_is_done_file_by_file(tmp_path: Path) -> None:
    jobs = jobs_of(tmp_path, recipe(), [*NAMES, "e.ply", "f.ply"])
    pool = LosingPool(jobs[1].source)
    found = [pair for results in run_together(pool, jobs, 3, 1) for pair in results]
    assert pool.sizes == [3, 3, 1, 1, 1]
    assert sorted(job.number for job, _ in found) == list(range(6))
    assert [job.number for job, made in found if isinstance(made, Failure)] == [1]


def test_bundles_are_small_files_shared_among_the_workers(tmp_path: Path) -> None:
    jobs = jobs_of(tmp_path, recipe(), [*NAMES, "large.ply"])
    jobs[4].source.write_bytes(bytes(bundle.SMALL + 1))
    pool = LosingPool(tmp_path / "none")
    assert len([pair for results in run_together(pool, jobs, 100, 2) for pair in results]) == 5
    assert pool.sizes == [2, 2, 1]
    pool = LosingPool(tmp_path / "none")
    assert len([pair for results in run_together(pool, jobs, 1, 2) for pair in results]) == 5
    assert pool.sizes == [1] * 5
