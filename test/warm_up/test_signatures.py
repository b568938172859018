"""Types of kernels as text: there and back."""

import numpy as np
import pytest
from numba import typeof, types

from cable_shape.kernels.network.tables import Solution
from cable_shape.warm_up.signatures import text_of, types_of

FROZEN = np.zeros(3)
FROZEN.flags.writeable = False
VALUES = (
    1.5, 2, True, None, np.zeros(3), np.zeros((2, 3)), np.zeros((4, 3))[:, 1:], np.zeros((3, 2)).T,
    np.zeros(2, np.int64), FROZEN, (1.0, 2.0, 3.0), ((1.0, 2.0), 3), Solution(*[np.zeros(1)] * len(Solution._fields)),
    Solution(*[np.zeros((1, 1)), *[np.zeros(1)] * (len(Solution._fields) - 1)]),
)  # fmt: skip


def test_types_come_back_from_their_text() -> None:
    given = tuple(typeof(value) for value in VALUES)
    text = text_of(given)
    assert text.startswith(
        "(f8,i8,b1,none,f8[1C],f8[2C],f8[2A],f8[2F],i8[1C],f8[1C!],(f8,f8,f8),((f8,f8),i8),network.tables."
    )
    assert types_of(text) == given


def test_what_has_no_text_is_refused_by_name() -> None:
    with pytest.raises(ValueError, match="unicode_type has no text"):
        text_of((types.unicode_type,))
    with pytest.raises(ValueError, match="is no type"):
        types_of("(f8,f4)")
    with pytest.raises(AttributeError, match="NoSuch"):
        types_of("(network.tables.NoSuch(f8))")
