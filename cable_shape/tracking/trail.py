"""A solver that can go back to where it was: :class:`Trail`."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, final

Here = tuple[Any, Any]


@final
class Trail:
    """Solves one problem after the other, each from the last shape on.

    Where it goes back it takes up the shape that it had, with what that touches and on which side.

    Parameters
    ----------
    make : callable
        A solver of cables or of harnesses, :class:`.solvers.Rod` or :class:`.harness_solver.HarnessSolver`, cold.
    """

    def __init__(self, make: Callable[[], Any]) -> None:
        self._make = make
        self.reset()

    #: Whether a shape that touches something is followed; else each is found from nothing: of those that a cable may
    #: have where nothing is known of it, the first is as good as any.
    follows = True

    def reset(self) -> None:
        """Forgets all shapes."""
        self._solver = self._make()
        self._before: Any = None  # the solver as it was before the last shape; None: it touched something
        self.here: Here | None = None  #: the last usable shape, and its problem, which stays as it is
        self._then: Here | None = None

    def solve(self, problem: Any) -> Any:
        """The shape of a problem that is used only here."""
        self._then = self.here
        if self._solver.touching and not self.follows:
            self._solver = self._make()
        self._before = None if self._solver.touching else self._solver.twin(problem, None)
        shape = self._solver.solve(problem)
        if shape.status:
            self.here = problem, shape
        return shape

    def go_back(self) -> None:
        """Forgets the last shape, and goes on from the one before."""
        if self._before is None:
            self.go_to(self._then)
            return
        self._solver, self.here = self._before, self._then
        self._before = None

    def go_to(self, here: Here | None) -> None:
        """Goes on from a shape that was the last one; None: from nothing."""
        self.reset()
        if here is not None:
            self._solver.begin(*here)
            self.here = here

    @property
    def memory(self) -> Any:
        """The solver's, of the last shape, in contact or not; None: there is none."""
        return self._solver.rod_state()
