"""The judge's test whether forces balance a load, against a linear program."""

import numpy as np
import pytest
import scipy

from hmap_core.validation import forces


def solvable(columns, load) -> bool:
    found = scipy.optimize.linprog(np.zeros(columns.shape[1]), A_eq=columns, b_eq=load, bounds=(0.0, None))
    return bool(found.success)


@pytest.mark.parametrize("rows", [4, 7, 12])
def test_a_balance_is_found_where_a_linear_program_finds_one(rows):
    rng = np.random.default_rng(rows)
    found = []
    for count in rng.integers(rows // 2, 4 * rows, 60):
        columns = rng.normal(size=(rows, count))
        found.append(forces.balance(columns, rng.normal(size=rows)))
        load = columns @ np.maximum(rng.normal(size=count), 0.0)
        assert forces.balance(columns, load)
        other = rng.normal(size=rows)
        assert forces.balance(columns, other) == solvable(columns, other)
    assert 5 < sum(found) < 55


def test_no_forces_balance_no_load_only():
    none = np.zeros((4, 0))
    assert forces.balance(none, np.zeros(4)) and not forces.balance(none, np.ones(4))


def test_a_search_that_does_not_end_is_replaced_by_a_linear_program(monkeypatch):
    def endless(*_):
        raise RuntimeError("Maximum number of iterations reached.")

    monkeypatch.setattr(scipy.optimize, "nnls", endless)
    assert forces.balance(np.eye(3), np.ones(3)) and not forces.balance(np.eye(3), -np.ones(3))
