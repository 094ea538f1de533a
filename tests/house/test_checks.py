"""Gains as matrices: what counts as symmetric and definite, in any units."""

import numpy as np
import pytest

from pinadapt._checks import definite_matrix
from pinadapt.exceptions import GainError


@pytest.mark.parametrize("scale", [[1.0, 1.0, 1.0], [1e-6, 1.0, 1e6]])
def test_asymmetry_from_rounding_is_averaged_out_and_more_is_refused(scale):
    root = np.array([[1.0, 0.0, 0.0], [0.3, 1.0, 0.0], [0.0, -0.2, 1.0]])
    exact = np.outer(scale, scale) * (root @ root.T)
    rounded = exact.copy()
    rounded[0, 2] += 1e-20
    rounded[1, 0] *= 1.0 + 1e-12
    taken = definite_matrix(rounded, 3, "K")
    assert np.array_equal(taken, taken.T)
    assert np.allclose(taken, exact, rtol=1e-12, atol=1e-20)
    for row, column in ((0, 1), (2, 0), (1, 2)):
        matrix = exact.copy()
        matrix[row, column] += 1e-6 * scale[row] * scale[column]
        with pytest.raises(GainError, match="K: the matrix must be symmetric"):
            definite_matrix(matrix, 3, "K")


@pytest.mark.parametrize("matrix", [np.diag([1.0, -1e-9]), [[1.0, 2.0], [2.0, 1.0]]])
def test_a_matrix_that_is_not_definite_is_refused(matrix):
    with pytest.raises(GainError, match="positive definite"):
        definite_matrix(matrix, 2, "K")
