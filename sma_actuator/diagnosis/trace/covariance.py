"""How far off readings are together: D² / share + V Vᵀ, asked without ever making a matrix of all rows."""

from __future__ import annotations

import math

import numpy as np


class Covariance:
    """D² / share + V Vᵀ of rows; D: how far off each is by itself."""

    def __init__(self, *columns: np.ndarray, share: float = 1.0, alone: tuple[np.ndarray, np.ndarray] | None = None):
        """``columns``: what is off together, (rows, …) each; ``share``: as how much of one each reading counts;
        ``alone``: D, where it is not one, and as how many readings each row counts."""
        self._root = math.sqrt(share)
        self._columns = np.column_stack(columns) if columns else None
        self._alone = alone
        together = self._root * self._by_itself(self._columns) if self._columns is not None else np.zeros((1, 0))
        squares, vectors = np.linalg.eigh(together.T @ together)
        some = squares > 1e-9 * max(float(squares.max(initial=0.0)), 1e-9)
        squares, vectors = squares[some], vectors[:, some]
        self._together = together
        #: How much rows shrink along what is off together, (columns, columns).  No more than half of it, so that
        #: columns that say nearly the same do not blow up what is rounded.
        self._shrink = vectors * ((1.0 - 1.0 / np.sqrt(1.0 + squares)) / squares) @ vectors.T
        #: Logarithm of the determinant.
        self.log_determinant = float(np.sum(np.log1p(squares)))
        if alone is not None:
            self.log_determinant += self.of_sizes(*alone)

    def of_sizes(self, size: np.ndarray, counts: np.ndarray) -> float:
        """What rows add to the logarithm of the determinant that are so many times as far off by themselves, where each
        counts as so many readings."""
        return 2.0 * self._root**2 * float(np.log(size) @ counts)

    def of(self, seen: np.ndarray) -> Covariance:
        """The same of some of the rows (bool)."""
        columns = () if self._columns is None else (self._columns[seen],)
        alone = None if self._alone is None else (self._alone[0][seen], self._alone[1][seen])
        return Covariance(*columns, share=self._root**2, alone=alone)

    def whiten(self, rows: np.ndarray) -> np.ndarray:
        """Rows, (n,) or (n, m), that are independent of each other and of size one where nothing has happened."""
        return self._apart(self._by_itself(rows))

    def inverse(self, rows: np.ndarray) -> np.ndarray:
        """The inverse of this covariance times rows."""
        return self._by_itself(self._apart(self.whiten(rows)))

    def likelihood(self, rows: np.ndarray) -> tuple[float, np.ndarray]:
        """Its logarithm, and each row's part of the squares."""
        by_row = rows * self.inverse(rows)
        return self.log_likelihood(float(np.sum(by_row))), by_row

    def log_likelihood(self, squares: float) -> float:
        """Logarithm of the likelihood of whitened rows with this sum of squares, up to what is common to all."""
        return -0.5 * (squares + self.log_determinant)

    def _by_itself(self, rows: np.ndarray) -> np.ndarray:
        return rows if self._alone is None else (rows.T / self._alone[0]).T

    def _apart(self, rows: np.ndarray) -> np.ndarray:
        if self._columns is None:
            return self._root * rows
        return self._root * (rows - self._together @ (self._shrink @ (self._together.T @ rows)))
