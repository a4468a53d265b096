"""Real meshes, ugly ones above all: every file that has faces deforms, and the armadillo does so accurately."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import scipy.sparse as sparse
from scipy.sparse.linalg import splu

import oneform_warp as ow
from oneform_warp.filters import read_mesh
from oneform_warp.solvers import Solver

BOX = 1e-5  # of the bounding box: what the default precision promises
FORMATS = {".obj", ".off", ".ply", ".stl", ".glb"}


def ends(x: np.ndarray, angle: float) -> list[ow.Handle]:
    """Holds one tenth of the mesh along its longest axis and turns the other end about that axis."""
    axis = int(np.argmax(np.ptp(x, axis=0)))
    t = (x[:, axis] - x[:, axis].min()) / np.ptp(x[:, axis])
    return [ow.Handle(t <= 0.1, held=True, name="low"), ow.Handle(t >= 0.9, axis="xyz"[axis], angle=angle, name="high")]


def mesh_files(folder: Path) -> list[Path]:
    return sorted(p for p in folder.rglob("*") if p.suffix.lower() in FORMATS)


def test_every_file_with_faces_deforms_to_finite_positions(meshes: Path) -> None:
    pytest.importorskip("pymeshlab", reason="reads the files")
    deformed = 0
    for path in mesh_files(meshes):
        mesh = read_mesh(path)
        faces = mesh.faces
        if not len(faces[1] if isinstance(faces, tuple) else faces) or np.ptp(mesh.positions) == 0.0:
            continue
        solution = ow.Deformer(mesh.positions, faces).solve(ends(mesh.positions, 90.0))
        assert solution.converged, (path.name, solution.status)
        assert np.isfinite(solution.x).all(), path.name
        held = ends(mesh.positions, 90.0)[0].vertices
        assert (solution.x[held] == mesh.positions[held]).all(), path.name
        # What turns about an axis stays near it: no part flies off.
        assert np.ptp(solution.x, axis=0).max() < 3.0 * np.ptp(mesh.positions, axis=0).max(), path.name
        deformed += 1
    assert deformed >= 90


def direct_solution(graph: ow.Graph, x: np.ndarray, v: np.ndarray, held: np.ndarray) -> np.ndarray:
    """The minimiser by SuperLU in float64, x kept where held."""
    i, j = graph.edges.T
    rows = np.arange(graph.edge_count)
    one = np.ones(graph.edge_count)
    d = sparse.coo_array((np.r_[one, -one], (np.r_[rows, rows], np.r_[j, i])), shape=(len(rows), len(x))).tocsc()
    mu = sparse.diags_array(graph.mu.numpy())
    laplacian, right = (d.T @ mu @ d).tocsc(), d.T @ (mu @ v)
    free = np.flatnonzero(~held)
    y = x.copy()
    y[free] = splu(laplacian[free][:, free].tocsc()).solve(
        right[free] - laplacian[free][:, np.flatnonzero(held)] @ x[held]
    )
    return y


@pytest.mark.parametrize("solver", [ow.CG(), ow.Multigrid(), ow.SuperLU()])
def test_the_armadillo_turns_its_arm_as_a_direct_solver_says(solver: Solver, meshes: Path) -> None:
    pytest.importorskip("pymeshlab", reason="reads the files")
    mesh = read_mesh(meshes / "paper" / "libigl_armadillo.obj")
    x, box = mesh.positions, np.ptp(mesh.positions, axis=0).max()
    side = (x[:, 0] - x[:, 0].min()) / np.ptp(x[:, 0])
    held = (side > 0.35) & (side < 0.65)
    handles = [ow.Handle(held, held=True), ow.Handle(side < 0.12, axis="z", angle=90)]
    deformer = ow.Deformer(x, mesh.faces, solver=solver)
    solution = deformer.solve(handles)
    assert solution.converged
    # Fields and positions both: the reference starts from the handles, not from our fields.
    reference = reference_deformation(deformer.graph, x, held, side < 0.12)
    assert np.abs(solution.x - reference).max() < BOX * box


def reference_deformation(graph: ow.Graph, x: np.ndarray, held: np.ndarray, turned: np.ndarray) -> np.ndarray:
    """Harmonic omega about z by a direct solve, v, and the minimiser by a direct solve."""
    omega = np.zeros_like(x)
    omega[turned, 2] = np.pi / 2
    omega = direct_solution(graph, omega, np.zeros((graph.edge_count, 3)), held | turned)
    i, j = graph.edges.T
    angle = (omega[i, 2] + omega[j, 2]) / 2
    dx = x[j] - x[i]
    c, s = np.cos(angle), np.sin(angle)
    v = np.column_stack([c * dx[:, 0] - s * dx[:, 1], s * dx[:, 0] + c * dx[:, 1], dx[:, 2]])
    return direct_solution(graph, x, v, held)


def reached_turn(x: np.ndarray, y: np.ndarray) -> float:
    """Degrees that the last cross-section of a bar along z has turned: each is fitted as a whole, whole turns counted."""
    plane = np.array([1.0, 1.0j])
    phases = []
    for height in np.unique(np.round(x[:, 2], 3)):
        section = np.abs(x[:, 2] - height) < 2e-3
        rest, now = ((p[section, :2] - p[section, :2].mean(axis=0)) @ plane for p in (x, y))
        phases.append(np.angle((now * rest.conj()).sum()))
    return float(np.degrees(np.unwrap(phases)[-1]))


@pytest.mark.parametrize(("segments", "sides"), [(40, 8), (173, 35)])
def test_two_whole_turns_in_one_solve(segments: int, sides: int) -> None:
    x, faces = ow.shapes.bar(segments=segments, sides=sides)  # 1,410 and 26,672 vertices
    z = x[:, 2]
    solution = ow.Deformer(x, faces).solve([ow.Handle(z < 0.05, held=True), ow.Handle(z > 0.95, axis="z", angle=720)])
    assert solution.converged
    assert abs(reached_turn(x, solution.x) - 720.0) < 15.0


def test_the_paper_bar_turns_twice(meshes: Path) -> None:
    pytest.importorskip("pymeshlab", reason="reads the files")
    mesh = read_mesh(meshes / "arap_demo" / "bar1.off")
    axis = int(np.argmax(np.ptp(mesh.positions, axis=0)))
    x = np.roll(mesh.positions, 2 - axis, axis=1)
    x = (x - x.min(axis=0)) / np.ptp(x[:, 2])
    handles = [ow.Handle(x[:, 2] < 0.05, held=True), ow.Handle(x[:, 2] > 0.95, axis="z", angle=720)]
    assert abs(reached_turn(x, ow.Deformer(x, mesh.faces).solve(handles).x) - 720.0) < 15.0


def medit_block(words: list[str], name: str, width: int) -> np.ndarray:
    """The rows of one block of a Medit file, their last number, a label, left out."""
    at = words.index(name)
    count = int(words[at + 1])
    return np.array(words[at + 2 : at + 2 + count * width], dtype=float).reshape(count, width)[:, :-1]


def test_a_tetrahedral_mesh_deforms_as_a_graph(meshes: Path) -> None:
    words = (meshes / "volume" / "libigl_hand.mesh").read_text().split()
    x = medit_block(words, "Vertices", 4)
    tetrahedra = medit_block(words, "Tetrahedra", 5).astype(int) - 1
    edges = np.concatenate([tetrahedra[:, [i, j]] for i in range(4) for j in range(i)])
    graph = ow.Graph.from_edges(len(x), np.unique(np.sort(edges, axis=1), axis=0))
    solution = ow.Deformer(x, graph).solve(ends(x, 90.0))
    held = ends(x, 90.0)[0].vertices
    assert solution.converged
    assert (solution.x[held] == x[held]).all()
    assert not (solution.x[~held] == x[~held]).all()
    volume = [np.abs(np.linalg.det(p[tetrahedra[:, 1:]] - p[tetrahedra[:, :1]])).sum() / 6 for p in (x, solution.x)]
    # Inner edges keep the volume of a quarter turn: a surface alone loses several per cent.
    assert volume[1] == pytest.approx(volume[0], rel=0.05)
