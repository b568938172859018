"""What a replay found: :class:`Outcome`."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import final

from cable_shape.replay.inertia import Inertia
from cable_shape.replay.inputs import Refusals
from cable_shape.replay.markers import MarkerComparison
from cable_shape.replay.settings import Settings
from cable_shape.replay.tally import Tally


@final
@dataclass(frozen=True, slots=True)
class Outcome:
    """What a replay found.

    `problems` says what of the recording could not be read; it is empty if all was.
    """

    settings: Settings
    bag: Path
    source: str  # "poses", "joints" or "tf"
    frame_id: str
    topics: dict[str, tuple[int, int | None]]  # topic -> messages read, messages that should be there
    tally: Tally
    refusals: Refusals
    unpaired: int
    markers: MarkerComparison | None  # None: it is not known where they are
    inertia: Inertia | None
    problems: tuple[str, ...]
    notes: tuple[str, ...]
    edits: int = 0  # requests that were repeated
