"""Sets of parameters defined by a linear matrix inequality, on which natural adaptation lives."""

from __future__ import annotations

import warnings
from collections.abc import Sequence
from functools import partial
from pathlib import Path

import numpy as np
from numpy import empty
from numpy.typing import ArrayLike

from .._checks import numbers, whole
from .._kernels import adaptation as kernels
from ..exceptions import ParameterError
from ..models.basis import read_matrix
from ..models.pseudo_inertia import COEFFICIENTS, nearest_physical, unphysical_bodies
from ..models.regressor import PER_BODY


class MatrixInequality:
    """The set of a with P_b(a) = F_0 + sum_i a_{b,i} F_i positive definite in k equal blocks b.

    A user's own inequality has one block; the bodies of a robot are k blocks of the same
    pseudo-inertia.

    Attributes:
        F: (p, n, n) coefficient matrices of one block, symmetric and linearly independent.
        blocks: k.
        complete: whether the F_i span all symmetric matrices, p = n (n + 1) / 2.
        tables: F_0 (n, n), and the e entries on and below the diagonals where F_i or D_i is not
            zero: their i, row and column (e, 3), then F_i and D_i there, both (e). The D_i are the
            dual basis in the span of F, tr(D_i F_j) = delta_ij.
    """

    def __init__(self, F: ArrayLike, *, offset: ArrayLike | None = None, blocks: int = 1) -> None:
        """Take the matrices (p, n, n) of a block, the constant F_0 (n, n) or None, and k.

        Raises:
            ParameterError: wrong shape, asymmetric or linearly dependent coefficients, or
                incomplete ones in many blocks.
        """
        self.F = numbers(F, "LMI", error=ParameterError)
        if self.F.ndim != 3 or self.F.shape[1] != self.F.shape[2] or not self.F.size:
            raise ParameterError(
                f"expected p square matrices, shape (p, n, n), got {self.F.shape}.", where="LMI"
            )
        if not np.allclose(self.F, self.F.transpose(0, 2, 1)):
            raise ParameterError("the coefficient matrices must be symmetric.", where="LMI")
        self.blocks, (self._p, self._n, _) = whole(blocks, "blocks", 0), self.F.shape
        flat = self.F.reshape(self._p, -1)
        if np.linalg.matrix_rank(flat) < self._p:
            raise ParameterError(
                "the coefficient matrices must be linearly independent.", where="LMI"
            )
        self.complete = self._p == self._n * (self._n + 1) // 2
        if blocks > 1 and not self.complete:
            raise ParameterError(
                "several blocks need coefficients that span all symmetric matrices.", where="LMI"
            )
        self._offset = None if offset is None else numbers(offset, "LMI", error=ParameterError)
        if self._offset is not None and (
            self._offset.shape != self.F.shape[1:] or not np.allclose(self._offset, self._offset.T)
        ):
            raise ParameterError(
                f"the offset must be a symmetric {self._n} x {self._n} matrix.", where="LMI"
            )
        self._flat = flat
        self._dual = np.linalg.solve(
            flat @ flat.T, flat
        )  # rows D_i in the span of F with tr(D_i F_j) = delta_ij
        self._dual_T = np.ascontiguousarray(self._dual.T)
        self.tables = self._tables()

    def _tables(self) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        D = self._dual.reshape(self.F.shape)
        D = np.where(np.abs(D) > 1e-15 * np.abs(D).max(), D, 0.0)
        entries = np.argwhere(np.tril((self.F != 0.0) | (D != 0.0)))
        at = tuple(entries.T)
        F_0 = np.zeros(self.F.shape[1:]) if self._offset is None else self._offset
        return F_0, np.ascontiguousarray(entries, dtype=np.int64), self.F[at], D[at]

    @classmethod
    def from_file(cls, path: Path) -> MatrixInequality:
        """Read F from a CSV file: a row for each parameter, its matrix written row by row.

        Raises:
            ParameterError: no such file, or rows that are not square matrices.
        """
        rows = read_matrix(path)
        n = round(rows.shape[1] ** 0.5)
        if n * n != rows.shape[1]:
            raise ParameterError(
                f"each row must hold n x n numbers, got {rows.shape[1]}.", where=str(path)
            )
        return cls(rows.reshape(-1, n, n))

    @property
    def size(self) -> int:
        """Number of parameters of all blocks."""
        return self.blocks * self._p

    def matrices(self, a: np.ndarray) -> np.ndarray:
        """Return P (k, n, n) at parameters a (k p)."""
        P = a.reshape(self.blocks, self._p).dot(self._flat).reshape(self.blocks, self._n, self._n)
        return P if self._offset is None else P + self._offset

    def components(self, P: np.ndarray) -> np.ndarray:
        """Return the coordinates (k p) of changes of P (k, n, n), which no offset changes.

        Of several changes (l, k, n, n) the l k p coordinates one after the other.
        """
        return P.reshape(-1, self._n * self._n).dot(self._dual_T).ravel()

    def covectors(self, g: np.ndarray) -> np.ndarray:
        """Return the symmetric L (k, n, n) with tr(L P(da)) = g . da for every da.

        Of several g (l, k p) those (l k, n, n) of one after the other.
        """
        return g.reshape(-1, self._p).dot(self._dual).reshape(-1, self._n, self._n)

    def metric_inverses(self, P: np.ndarray) -> np.ndarray:
        """Return a block (p, p) for each P (k, n, n): column i is P L P, tr(L P(da)) = da_i.

        Complete only; the inverse of the metric of -log det.
        """
        moved = P[:, None] @ self._dual.reshape(self.F.shape) @ P[:, None]
        return moved.reshape(len(P), self._p, -1).dot(self._dual_T)

    def contains(self, a: np.ndarray) -> bool:
        """Tell whether every block is positive definite at a (k p)."""
        return bool((np.linalg.eigvalsh(self.matrices(a)) > 0.0).all())

    def follow_geodesic(self, a: np.ndarray, g: np.ndarray, h: float) -> np.ndarray:
        """Return the parameters (k p) of P+ = exp(-h P L) P, tr(L P(da)) = g . da; complete only.

        The step is cut where it is longer than ``LARGEST_STEP`` in the log-det metric.
        """
        after = empty(a.size)
        kernels.follow_geodesic(a, g, h, *self.tables, after)
        return after

    def validate(self, a: np.ndarray) -> np.ndarray:
        """Return ``a`` if it lies inside.

        Raises:
            ParameterError: it does not.
        """
        if not self.contains(a):
            raise ParameterError(
                f"the initial estimate {np.round(a, 6).tolist()} is outside the matrix inequality "
                "of natural adaptation.",
                where="belief.dynamic",
                hint="Start from an estimate inside, or use gradient adaptation.",
            )
        return a


class BodyInequality(MatrixInequality):
    """Physical inertial parameters: the pseudo-inertia of each body is positive definite."""

    def __init__(
        self, names: Sequence[str], *, least_mass: float = 1e-6, least_radius: float = 1e-3
    ) -> None:
        """Take one name a body, and how far inside unphysical bodies are moved.

        Args:
            names: of the bodies, for messages.
            least_mass: kg.
            least_radius: m; the second moment about the centre of mass becomes at least mass times
                its square.
        """
        super().__init__(COEFFICIENTS, blocks=len(names))
        self._names = tuple(names)
        self._repair = partial(nearest_physical, least_mass=least_mass, least_radius=least_radius)

    def follow_geodesic(self, a: np.ndarray, g: np.ndarray, h: float) -> np.ndarray:
        """Return the parameters (10 k) of P+ = exp(-h P L) P, by the explicit form of P and L."""
        after = empty(a.size)
        kernels.follow_geodesic_of_bodies(a, g, h, after)
        return after

    def validate(self, a: np.ndarray) -> np.ndarray:
        """Return ``a`` with unphysical bodies moved inside the cone; a warning names them."""
        names = unphysical_bodies(a, self._names)
        if not names:
            return a
        warnings.warn(
            f"the inertias of the bodies moved by {names} are not physical (pseudo-inertia not "
            "positive definite); the initial estimate was moved to physical values close by.",
            stacklevel=2,
        )
        repaired = [
            self._repair(pi) if name in names else pi
            for name, pi in zip(self._names, a.reshape(-1, PER_BODY), strict=True)
        ]
        return np.concatenate(repaired)
