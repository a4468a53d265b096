"""MeshLab follows late, and nobody can tell: not a filter, not a mesh that is asked for, not a file."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from mesh_sets import bar, positions

pymeshlab = pytest.importorskip("pymeshlab")

import oneform_warp as ow  # noqa: E402
from oneform_warp.errors import InputError  # noqa: E402
from oneform_warp.filters import Chain, MeshSet, Step  # noqa: E402
from oneform_warp.filters.deferred import DeferredMeshSet  # noqa: E402
from oneform_warp.filters.meshfile import read_mesh  # noqa: E402
from oneform_warp.filters.native import native_filters  # noqa: E402

TURN = [
    Step("set_oneform_handle", {"condselect": "z < zmin + 0.1*(zmax-zmin)", "held": True}),
    Step("set_oneform_handle", {"condselect": "z > zmin + 0.9*(zmax-zmin)", "angle": 50}),
    Step("apply_coord_oneform_deformation", {"solver": "cg"}),
]
SMOOTH = Step("apply_coord_laplacian_smoothing", {"stepsmoothnum": 2})


def write_ply(path: Path, faces: object = None, *, extra: tuple[str, ...] = (), kind: str = "int") -> Path:
    """A binary PLY of a bar; `extra` are float properties of its vertices with random values."""
    x, triangles = ow.shapes.bar(segments=12, sides=4)
    faces = triangles if faces is None else faces
    columns = [x, np.random.default_rng(0).random((len(x), len(extra)))]
    names = [f"property float {name}" for name in ("x", "y", "z", *extra)]
    lists = f"property list uchar {kind} vertex_indices"
    head = ["ply", "format binary_little_endian 1.0", f"element vertex {len(x)}", *names]
    body = b"".join(bytes([len(f)]) + np.asarray(f).astype("<i4").tobytes() for f in faces)
    text = "\n".join([*head, f"element face {len(faces)}", lists, "end_header", ""])
    path.write_bytes(text.encode() + np.hstack(columns).astype("<f4").tobytes() + body)
    return path


def moves(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """What MeshLab is made to do, from now on."""
    done: list[str] = []
    for name in ("load_new_mesh", "add_mesh"):
        native = getattr(DeferredMeshSet, name)
        monkeypatch.setattr(
            DeferredMeshSet,
            name,
            lambda self, *a, _n=native, _name=name, **k: (done.append(_name), _n(self, *a, **k))[1],
        )
    return done


# ------------------------------------------------------------------ positions


def test_all_that_pymeshlab_offers_settles_first() -> None:
    offered = {name for name in dir(pymeshlab.MeshSet) if not name.startswith("_")} - native_filters()
    own = {"current_mesh_id", "mesh_number"}  # which do not depend on where vertices are
    assert offered - own <= vars(DeferredMeshSet).keys()
    assert len(offered) > 20


@pytest.mark.parametrize(
    "ask",
    [
        lambda meshes: positions(meshes),
        lambda meshes: np.array(next(iter(meshes)).vertex_matrix()),
        lambda meshes: np.array(meshes[0].vertex_matrix()),
        lambda meshes: np.array(meshes.mesh(0).vertex_matrix()),
        lambda meshes: meshes.vertex_matrix(),
    ],
)
def test_whoever_asks_gets_the_new_positions(ask: object) -> None:
    meshes = bar(MeshSet(deferred=True))
    wanted = positions(meshes) * [1.0, 2.0, 1.0 / 3.0] + 0.1
    meshes.set_vertex_matrix(wanted)
    assert np.array_equal(ask(meshes), wanted)  # type: ignore[operator]


def test_a_native_filter_works_on_the_new_positions() -> None:
    late, at_once = bar(MeshSet(deferred=True)), bar()
    for meshes in (late, at_once):
        meshes.set_vertex_matrix(meshes.vertex_matrix() * 1.7)
        meshes.apply_coord_laplacian_smoothing(stepsmoothnum=1)
    assert np.array_equal(positions(late), positions(at_once))


def test_positions_that_are_given_and_taken_are_copies() -> None:
    meshes = bar(MeshSet(deferred=True))
    given = meshes.vertex_matrix() + 1.0
    wanted = given.copy()
    meshes.set_vertex_matrix(given)
    given[:] = 7.0
    meshes.vertex_matrix()[:] = 8.0
    assert np.array_equal(positions(meshes), wanted)


def test_without_deferring_a_mesh_taken_before_moves_too() -> None:
    meshes = bar()
    mesh = meshes.current_mesh()
    meshes.set_vertex_matrix(meshes.vertex_matrix() + 1.0)
    assert np.array_equal(mesh.vertex_matrix(), meshes.vertex_matrix())


def test_a_chain_on_a_meshset_ends_with_everything_in_meshlab() -> None:
    meshes = bar()
    mesh = meshes.current_mesh()
    Chain(TURN).apply(meshes)
    assert np.array_equal(mesh.vertex_matrix(), meshes.vertex_matrix())
    failing = Chain([*TURN, Step("set_oneform_handle", {"condselect": "z > 1e9"})])
    meshes = bar()
    mesh = meshes.current_mesh()
    rest = positions(meshes)
    with pytest.raises(InputError, match="no vertex is selected"):
        failing.apply(meshes)
    assert not np.array_equal(mesh.vertex_matrix(), rest)


def test_deforming_twice_gives_meshlab_nothing_in_between(monkeypatch: pytest.MonkeyPatch) -> None:
    meshes = bar(MeshSet(deferred=True))
    done = moves(monkeypatch)
    for step in [
        *TURN,
        Step("set_oneform_handle", {"name": "handle 2", "condselect": "vi > 216", "angle": 10}),
        TURN[-1],
    ]:
        meshes.apply_step(step)
    assert done == []
    once = bar()
    for step in [
        *TURN[:2],
        Step("set_oneform_handle", {"name": "handle 2", "condselect": "vi > 216", "angle": 10}),
        TURN[-1],
    ]:
        once.apply_step(step)
    assert np.array_equal(positions(meshes), positions(once))


# ------------------------------------------------------------------ files


def test_a_chain_of_ours_needs_no_meshlab_and_gives_the_same_bytes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    source = write_ply(tmp_path / "bar.ply", extra=("nx", "ny", "nz", "mass"))
    meshes = MeshSet()
    file = read_mesh(source, mesh_set=meshes)
    Chain(TURN).run(meshes)
    omega = meshes.placed_handles().result.solution.omega
    file.write(tmp_path / "known.ply", positions(meshes), omega=omega)
    done = moves(monkeypatch)
    report = Chain(TURN).process(source, tmp_path / "out.ply")
    assert done == []
    assert report.moved_only
    assert (tmp_path / "out.ply").read_bytes() == (tmp_path / "known.ply").read_bytes()


def test_steps_of_meshlab_get_the_file_from_meshlab(tmp_path: Path) -> None:
    source = write_ply(tmp_path / "bar.ply")
    Chain([*TURN, SMOOTH, TURN[-1]]).process(source, tmp_path / "out.ply")
    meshes = MeshSet()
    meshes.load_new_mesh(source)
    for step in [*TURN, SMOOTH, TURN[-1]]:
        meshes.apply_step(step)
    written = read_mesh(tmp_path / "out.ply").positions
    assert np.array_equal(written, positions(meshes).astype(np.float32))


def test_a_filter_that_asks_for_more_has_the_file_read(tmp_path: Path) -> None:
    source = write_ply(tmp_path / "bar.ply", extra=("paint",))
    painted = Step("set_oneform_handle", {"attribute": "paint", "angle": 20})
    report = Chain([painted, TURN[-1]]).process(source, tmp_path / "out.ply")
    assert report.moved_only
    shown = Step("compute_scalar_oneform_field", {})
    report = Chain([*TURN, shown]).process(source, tmp_path / "field.ply")
    assert not report.moved_only
    quality = read_mesh(tmp_path / "field.ply").quality
    assert quality is not None
    assert np.ptp(quality) > 0.1


def test_names_beyond_positions_have_the_file_read(tmp_path: Path) -> None:
    source = write_ply(tmp_path / "bar.ply")
    by_normal = Step("set_oneform_handle", {"condselect": "nz > 0.9", "angle": 20})
    assert Chain([TURN[0], by_normal, TURN[-1]]).process(source, tmp_path / "out.ply").moved_only
    with pytest.raises(InputError, match=r"unknown variable 'zz'.*nx"):
        Chain([Step("set_oneform_handle", {"condselect": "zz > 0"}), TURN[-1]]).process(source, tmp_path / "out.ply")


X, FACES = ow.shapes.bar(segments=12, sides=4)
OTHERS = {
    "quads": [[0, 1, 2, 3], *FACES.tolist()],
    "degenerate": [[0, 0, 1], *FACES.tolist()],
}


@pytest.mark.parametrize("faces", OTHERS.values(), ids=OTHERS)
def test_what_meshlab_reads_otherwise_is_read_by_meshlab(tmp_path: Path, faces: object) -> None:
    source = write_ply(tmp_path / "other.ply", faces)
    meshes = MeshSet(deferred=True)
    read_mesh(source, mesh_set=meshes, later=True)
    assert not meshes.unread


def test_files_that_are_read_later_are_read_the_same(tmp_path: Path) -> None:
    for name, kind in (("a.ply", "int"), ("b.ply", "uint")):
        meshes = MeshSet(deferred=True)
        file = read_mesh(write_ply(tmp_path / name, kind=kind), mesh_set=meshes, later=True)
        assert meshes.unread
        assert (meshes.mesh_number(), meshes.current_mesh_id()) == (1, 0)
        assert np.array_equal(positions(meshes), file.positions)
        assert not meshes.unread
        assert (meshes.mesh_number(), meshes.current_mesh_id()) == (1, 0)
        assert np.array_equal(meshes.current_mesh().face_matrix(), file.faces)


def test_broken_files_fail_as_before(tmp_path: Path) -> None:
    whole = write_ply(tmp_path / "whole.ply").read_bytes()
    cut = tmp_path / "cut.ply"
    cut.write_bytes(whole[:-40])
    with pytest.raises(ow.errors.FileError, match=r"cut\.ply"):
        Chain(TURN).process(cut, tmp_path / "out.ply")
    beyond = write_ply(tmp_path / "beyond.ply", [[0, 1, 9999], *FACES.tolist()])
    with pytest.raises(ow.errors.FileError, match="vertex 9999"):
        Chain(TURN).process(beyond, tmp_path / "out.ply")
    assert not (tmp_path / "out.ply").exists()
