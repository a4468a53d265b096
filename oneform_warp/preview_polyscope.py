"""The process in which polyscope draws off-screen: reads in.npz from a folder and writes out.npz there."""

import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

__all__ = ["draw"]

WIREFRAME = 2500  # up to so many faces, their edges are drawn
FIELD = 24.0  # vertical field of view in degrees: nearly without perspective


def draw(folder: Path) -> None:
    """Draw all panels of in.npz; polyscope raises, or ends the process, where there is no driver."""
    import polyscope

    with np.load(folder / "in.npz") as arrays:
        values = dict(arrays)
    polyscope.set_verbosity(0)
    polyscope.set_use_prefs_file(False)
    polyscope.init("openGL3_egl")
    polyscope.set_ground_plane_mode("none")
    polyscope.set_SSAA_factor(3)
    polyscope.set_window_size(*map(int, values["cell"]))
    pictures = {str(i): _picture(polyscope, values, f"{i}.") for i in range(int(values["count"]))}
    np.savez(folder / "out.npz", **pictures)  # type: ignore[arg-type]


def _picture(polyscope: Any, values: Mapping[str, NDArray[Any]], key: str) -> NDArray[np.uint8]:
    """One panel as (height, width, 3)."""
    x, colors, marks = values[key + "x"], values[key + "colors"], values[key + "marks"]
    offsets = values[key + "offsets"]
    colors = colors**1.7  # the material is light and washes colours out
    sizes = np.diff(offsets)
    polyscope.remove_all_structures()
    if len(sizes):
        faces = np.split(values[key + "indices"], offsets[1:-1])
        table: Any = np.stack(faces) if np.all(sizes == sizes[0]) else [face.tolist() for face in faces]
        wires = len(sizes) <= WIREFRAME
        mesh = polyscope.register_surface_mesh("mesh", x, table, smooth_shade=not wires, material="clay")
        mesh.set_back_face_policy("identical")
        mesh.set_edge_width(0.3 if wires else 0.0)
        mesh.set_edge_color((0.55, 0.57, 0.60))
        mesh.add_color_quantity("colors", colors, enabled=True)
    dots = marks if len(sizes) else np.arange(len(x))
    if len(dots):
        reach = float(values[key + "reach"])
        cloud = polyscope.register_point_cloud("dots", x[dots], material="flat")
        cloud.set_radius((0.018 if len(sizes) else 0.012) * reach, relative=False)
        cloud.add_color_quantity("colors", colors[dots], enabled=True)
    _look(polyscope, values, key)
    picture = polyscope.screenshot_to_buffer(transparent_bg=False)
    return np.asarray(picture)[..., :3].astype(np.uint8)


def _look(polyscope: Any, values: Mapping[str, NDArray[Any]], key: str) -> None:
    """Place the camera so that the sphere of the wanted reach fills the picture."""
    width, height = map(int, values["cell"])
    basis, centre, reach = values[key + "basis"], values[key + "centre"], float(values[key + "reach"])
    depth = np.ptp(values[key + "x"] @ basis[2]) / 2
    distance = 1.06 * reach / np.tan(np.radians(FIELD / 2)) * max(1.0, height / width) + depth
    polyscope.set_view_camera_parameters(
        polyscope.CameraParameters(
            polyscope.CameraIntrinsics(fov_vertical_deg=FIELD, aspect=width / height),
            polyscope.CameraExtrinsics(root=centre + distance * basis[2], look_dir=-basis[2], up_dir=basis[1]),
        )
    )


if __name__ == "__main__":
    draw(Path(sys.argv[1]))
