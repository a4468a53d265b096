"""Rotation vectors as Warp functions: the exponential map and the edge transform, for any kernel."""

import warp as wp

__all__ = ["exponential_map", "rotate", "transform_edge"]


@wp.func
def rotate(omega: wp.vec3d, d: wp.vec3d) -> wp.vec3d:
    """R(omega) d by Rodrigues: d + sin|w|/|w| w x d + (1 - cos|w|)/|w|^2 w x (w x d).

    omega: rotation vector in radians, of any length: whole turns are kept by the caller's fields, not lost here.
    omega = 0 returns d bit for bit.
    """
    angle = wp.length(omega)
    a = wp.float64(1.0)
    half = wp.float64(1.0)
    # Below 1e-8 the series' second terms are under float64's rounding.
    if angle > wp.float64(1.0e-8):
        a = wp.sin(angle) / angle
        half = wp.sin(angle / wp.float64(2.0)) / (angle / wp.float64(2.0))
    turned = wp.cross(omega, d)
    return d + a * turned + (half * half / wp.float64(2.0)) * wp.cross(omega, turned)


@wp.func
def exponential_map(omega: wp.vec3d) -> wp.mat33d:
    """R(omega), 3 x 3, of a rotation vector in radians."""
    zero = wp.float64(0.0)
    one = wp.float64(1.0)
    x = rotate(omega, wp.vec3d(one, zero, zero))
    y = rotate(omega, wp.vec3d(zero, one, zero))
    z = rotate(omega, wp.vec3d(zero, zero, one))
    return wp.matrix_from_cols(x, y, z)


@wp.func
def transform_edge(
    omega_i: wp.vec3d, omega_j: wp.vec3d, sigma_i: wp.float64, sigma_j: wp.float64, dx: wp.vec3d
) -> wp.vec3d:
    """v_ij = sigma_ij R(omega_ij) dx_ij, with the mean rotation vector and the geometric mean of the stretches."""
    return wp.sqrt(sigma_i * sigma_j) * rotate(wp.float64(0.5) * (omega_i + omega_j), dx)
