"""Triquadratic hexahedra for a nearly incompressible solid: displacement Q2, pressure P1 within each element.

    K = Int 2 mu eps : eps + B^T (M/lambda)^-1 B,      B = Int p div u,  M = Int p p

The pressure (1, x, y, z about the element's middle) has no neighbours, so it is solved for inside each element:
the pair is stable and does not lock as nu -> .5. Modulus 1 MPa. Quadrature 3 x 3 x 3.
Nodes of an element: index = a + 3 b + 9 c for the places (a, b, c) in {0, 1, 2}^3 along its own axes.

Source: Hughes, The Finite Element Method (1987), section 4.4 and table 4.3; Boffi, Brezzi, Fortin, Mixed Finite
Element Methods (2013), section 8.7 (Q2/P-1).
"""

from __future__ import annotations

import numpy as np
import numpy.typing as npt
from scipy import sparse

from tactilevision.records import Floats

Elements = npt.NDArray[np.intp]
# places and weights of the three-point Gauss rule on (-1, 1)
GAUSS = np.array([-np.sqrt(0.6), 0.0, np.sqrt(0.6)])
GAUSS_WEIGHT = np.array([5.0, 8.0, 5.0]) / 9  # of the same rule; they sum to 2


def quadratic(xi: Floats) -> tuple[Floats, Floats]:
    """Values and slopes (3, N) of the three quadratic functions on [-1, 1] at `xi` (N,)."""
    values = np.stack([xi * (xi - 1) / 2, 1 - xi**2, xi * (xi + 1) / 2])
    return values, np.stack([xi - 0.5, -2 * xi, xi + 0.5])


def shape_functions() -> tuple[Floats, Floats, Floats]:
    """At the 27 points: values (27 points, 27 nodes), slopes (27, 27, 3) by the element's own axes, weights
    (27,).
    """
    value, slope = quadratic(GAUSS)
    values = np.einsum("ip,jq,kr->rqpkji", value, value, value).reshape(27, 27)
    slopes = [
        np.einsum("ip,jq,kr->rqpkji", *parts).reshape(27, 27)
        for parts in ((slope, value, value), (value, slope, value), (value, value, slope))
    ]
    weights = np.einsum("i,j,k->kji", GAUSS_WEIGHT, GAUSS_WEIGHT, GAUSS_WEIGHT).ravel()
    return values, np.stack(slopes, axis=-1), weights


def stiffness(nodes_mm: Floats, elements: Elements, *, poisson_ratio: float) -> sparse.csc_matrix:
    """K (3 N, 3 N) of `nodes_mm` (N, 3) and `elements` (M, 27) at modulus 1 MPa; unknown 3 n + i is node n
    along i.
    """
    parts = [
        _element_matrices(nodes_mm[chunk], poisson_ratio) for chunk in np.array_split(elements, _chunks(elements))
    ]
    blocks = np.concatenate(parts)
    dofs = (3 * elements[:, :, None] + np.arange(3)).reshape(len(elements), 81)
    rows, columns = np.repeat(dofs, 81, axis=1).ravel(), np.tile(dofs, (1, 81)).ravel()
    size = 3 * len(nodes_mm)
    return sparse.csc_matrix(sparse.coo_matrix((blocks.ravel(), (rows, columns)), shape=(size, size)))


def _chunks(elements: Elements) -> int:
    return max(1, len(elements) // 200)


def _element_matrices(corners: Floats, poisson_ratio: float) -> Floats:
    """(m, 81, 81) of elements with node places `corners` (m, 27, 3)."""
    values, slopes, weights = shape_functions()
    jacobian = np.einsum("pna,mni->mpia", slopes, corners)
    measure = np.linalg.det(jacobian) * weights
    gradient = np.einsum("pna,mpai->mpni", slopes, np.linalg.inv(jacobian))
    mu = 1 / (2 * (1 + poisson_ratio))
    lame = poisson_ratio / ((1 + poisson_ratio) * (1 - 2 * poisson_ratio))
    weighted = gradient * measure[..., None, None]
    m = len(corners)
    # 2 mu eps(u):eps(v) = mu (u_i,j v_i,j + u_i,j v_j,i): `same` is the first, `cross` the second
    same = np.einsum("mpna,mpka->mnk", weighted, gradient, optimize=True)
    cross = np.matmul(
        weighted.transpose(0, 2, 3, 1).reshape(m, 81, 27), gradient.transpose(0, 1, 2, 3).reshape(m, 27, 81)
    )
    matrix = mu * cross.reshape(m, 27, 3, 27, 3).transpose(0, 1, 4, 3, 2)
    for i in range(3):
        matrix[:, :, i, :, i] += mu * same
    matrix = matrix.reshape(m, 81, 81)
    place = np.einsum("pn,mni->mpi", values, corners) - corners.mean(axis=1)[:, None]
    basis = np.concatenate([np.ones((m, 27, 1)), place], axis=2)
    mass = np.einsum("mp,mpa,mpb->mab", measure, basis, basis, optimize=True)
    divergence = np.einsum("mpa,mpni->mani", basis, weighted, optimize=True).reshape(m, 4, 81)
    projected = np.matmul(divergence.transpose(0, 2, 1), np.linalg.solve(mass, divergence))
    return np.asarray(matrix + lame * projected)
