"""Kernels that are called without asking for the types of their arguments."""

from typing import NamedTuple

import numpy as np
import pytest

from cable_shape.checks import Array
from cable_shape.kernels._jit import kernel
from cable_shape.kernels.direct import Direct


class Pair(NamedTuple):
    first: Array
    second: Array


@kernel
def filled(pair: Pair, factor: float) -> float:
    pair.second[:] = factor * pair.first
    return pair.second.sum()


def test_it_does_what_the_kernel_does():
    pair = Pair(np.arange(3.0), np.zeros(3))
    direct = Direct(filled)
    assert direct(pair, 2.0) == filled(pair, 2.0) == 6.0
    assert direct(Pair(np.ones(2), pair.second[:2]), 3.0) == 6.0
    assert pair.second.tolist() == [3.0, 3.0, 4.0]
    assert len(filled.overloads) == 1


def test_what_is_no_array_is_refused():
    direct = Direct(filled)
    direct(Pair(np.arange(3.0), np.zeros(3)), 2.0)
    with pytest.raises(TypeError):
        direct(Pair([0.0], [1.0]), 2.0)


def test_a_number_of_another_kind_is_not_cut_off():
    """Where the first call had a whole number, machine code takes whole numbers."""
    pair = Pair(np.ones(2), np.zeros(2))
    direct = Direct(filled)
    assert direct(pair, 2) == 4.0
    assert direct(pair, 2.5) == 5.0
