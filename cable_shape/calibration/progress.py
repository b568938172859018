"""How far a fit is, on a terminal: :class:`Progress`."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, final

#: [s], fits that are quicker show nothing.
_QUICK = 1.0


@final
class Progress:
    """Counts iterations on a terminal, and asks `proceed`, if there is one, whether to go on."""

    def __init__(self, shown: bool, proceed: Callable[[int, float], bool] | None = None) -> None:
        self._shown, self._proceed = shown, proceed
        self._bar: Any = None
        self.what = ""  # is fitted at present

    def __enter__(self) -> Progress:
        if self._shown:
            from tqdm import tqdm

            self._bar = tqdm(desc="calibrate", unit=" iterations", delay=_QUICK, disable=None, leave=False)
        return self

    def __exit__(self, *error: object) -> None:
        if self._bar is not None:
            self._bar.close()

    def step(self, iteration: int, scale: float) -> bool:
        """Takes one iteration, with the scale of the misses [m]; whether to go on."""
        if self._bar is not None:
            self._bar.set_postfix_str(f"{self.what}misses {1e3 * scale:.3g} mm", refresh=False)
            self._bar.update()
        return self._proceed is None or self._proceed(iteration, scale)
