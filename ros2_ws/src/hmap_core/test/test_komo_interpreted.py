"""Compiled, the optimiser computes what its source says: every case of ``interpreted_cases`` with numba and without.

With ``--cov`` the part without counts too, so compiled code is covered where a line of it really ran.
"""

import subprocess
import sys
from pathlib import Path

import interpreted_cases
import numpy as np
import pytest

TIMEOUT = 600.0  # s
SCRIPT = Path(__file__).parent / "interpreted_cases.py"


@pytest.fixture(scope="module")
def interpreted(tmp_path_factory):
    """The results of all cases without numba, from a process of its own."""
    out = tmp_path_factory.mktemp("interpreted") / "cases.npz"
    subprocess.run([sys.executable, str(SCRIPT), str(out)], check=True, timeout=TIMEOUT)
    return np.load(out)


@pytest.mark.slow
@pytest.mark.parametrize("case", interpreted_cases.CASES, ids=lambda case: case.__name__)
def test_compiled_code_does_what_its_source_says(case, interpreted):
    found, expected = np.array(case(), float), interpreted[case.__name__]
    np.testing.assert_allclose(found, expected, rtol=1e-6, atol=1e-6)
