"""Gains as matrices: what counts as symmetric and definite, in any units."""

import numpy as np
import pytest

from pinadapt._checks import definite_matrix
from pinadapt.exceptions import GainError


def definite(scale):
    """Return a symmetric positive definite matrix whose rows have units of their own."""
    root = np.array([[1.0, 0.0, 0.0], [0.3, 1.0, 0.0], [0.0, -0.2, 1.0]])
    return np.outer(scale, scale) * (root @ root.T)


@pytest.mark.parametrize("scale", [[1.0, 1.0, 1.0], [1e-6, 1.0, 1e6]])
def test_asymmetry_from_rounding_is_averaged_out(scale):
    exact = definite(np.array(scale))
    rounded = exact.copy()
    rounded[0, 2] += 1e-20
    rounded[1, 0] *= 1.0 + 1e-12
    taken = definite_matrix(rounded, 3, "K")
    assert np.array_equal(taken, taken.T)
    assert np.allclose(taken, exact, rtol=1e-12, atol=1e-20)


@pytest.mark.parametrize("scale", [[1.0, 1.0, 1.0], [1e-6, 1.0, 1e6]])
@pytest.mark.parametrize(("row", "column"), [(0, 1), (2, 0), (1, 2)])
def test_asymmetry_above_rounding_is_refused(scale, row, column):
    matrix = definite(np.array(scale))
    matrix[row, column] += 1e-6 * scale[row] * scale[column]
    with pytest.raises(GainError, match="K: the matrix must be symmetric"):
        definite_matrix(matrix, 3, "K")


@pytest.mark.parametrize(
    "matrix", [np.diag([1.0, 0.0]), np.diag([1.0, -1e-9]), [[1.0, 2.0], [2.0, 1.0]]]
)
def test_a_matrix_that_is_not_definite_is_refused(matrix):
    with pytest.raises(GainError, match="positive definite"):
        definite_matrix(matrix, 2, "K")
