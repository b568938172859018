"""The bodies that a cable may touch, as the compiled solver takes them: :class:`TouchBodies`."""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, final

import numpy as np

from cable_shape.checks import Array
from cable_shape.kernels.contact.tables import Bodies
from cable_shape.kernels.distance import bounds, distance, surface
from cable_shape.kernels.distance.triangles import STACK_SIZE
from cable_shape.pose import Pose
from cable_shape.scene.body_tables import body_tables, link_rows
from cable_shape.scene.mesh_convex import half_thickness
from cable_shape.scene.mesh_parts import divided
from cable_shape.scene.scene import Mesh, Obstacle

HORIZON = 0.02  #: [m] bodies further away are only bounded


def _dents(table: Array) -> Array:
    """(m,) [m], how deep a cable could lie between the spheres of each body, the middle of four of a lattice."""
    deep = np.minimum(0.5 * table[:, 19] ** 2, table[:, 18] ** 2)
    return np.where(table[:, 18] > 0.0, table[:, 18] - np.sqrt(table[:, 18] ** 2 - deep), 0.0)


@final
class TouchBodies:
    """What they are, where they are, and where they were at the last solution.

    Those on links come last; they are left out as long as it is not known where the links are. A body that is divided
    into convex parts is several, of one name.
    """

    def __init__(self) -> None:
        self._bodies: tuple[Obstacle, ...] = ()
        self._rows: list[Obstacle] = []
        self._off: Array = np.zeros(0)  # [m], of each row
        self.names: tuple[str, ...] = ()  # of the bodies whose places are known
        self.frames: Array = np.zeros((0, 4, 3))  # where they are
        self.frames_then = self.frames  # where they were at the last solution
        self.measured: Array = np.zeros((0, bounds.RESULT_COLUMNS))
        self._shift: Array = np.zeros(3)
        self.standing = False  # those on links are not shifted
        self.links: Array = np.empty((0, 7))
        self.stack: Any = np.empty(STACK_SIZE, np.int64)

    def are(self, bodies: tuple[Obstacle, ...]) -> bool:
        """Whether these are the same bodies, wherever they are."""
        return [(b.name, b.solid, b.link) for b in bodies] == [(b.name, b.solid, b.link) for b in self._bodies]

    def take(
        self,
        bodies: tuple[Obstacle, ...],
        gripping: frozenset[str],
        links: Mapping[str, Pose] | None,
        radius: float,
        carried: dict[str, str],
    ) -> bool:
        """Takes over a problem's bodies, for a cable of this radius [m]; True if other ones are now known.

        carried: the links that carry bodies, and after them clips.
        """
        self._bodies = bodies
        self._carried = carried
        self._rows, self._off = divided(bodies)
        self._tables = body_tables(self._rows, tuple(self._carried), gripping)
        for row, body in zip(self._tables[0], self._rows, strict=True):
            if isinstance(body.solid, Mesh):
                row[14] = half_thickness(body.solid)
            elif row[0] == distance.SPHERES and row[19] > 0.0:
                row[18] = row[14] + radius
        self._off = np.maximum(self._off, _dents(self._tables[0]))
        self._origins = self._tables[0][:, 4:7].copy()
        self.rough: Array = np.array([body.friction for body in self._rows])
        self._fixed = sum(body.link is None for body in self._rows)
        self.horizon = radius + HORIZON
        self.counts: Any = np.empty(2, np.int64)
        self.thinnest = min((surface.reach_of(body) for body in self._tables[0]), default=math.inf)
        return self._put(self.link_rows(links))

    def link_rows(self, links: Mapping[str, Pose] | None) -> Array:
        """(k, 7), poses of the links that carry bodies or clips; (0, 7): not known, or there are none.

        Raises
        ------
        ArgumentError
            If `links` lacks one of them.
        """
        return np.empty((0, 7)) if links is None or not self._carried else link_rows(links, self._carried)

    def move(self, links: Array) -> bool:
        """Puts those on links where these rows, see `link_rows`, say; True if other ones are now known than before."""
        return bool(len(links) or len(self.links)) and self._put(links)

    def _put(self, links: Array) -> bool:
        all_bodies, self.triangles, self.tree = self._tables
        count = len(all_bodies) if len(links) else self._fixed
        names = tuple(body.name for body in self._rows[:count])
        others = names != self.names
        if others:
            self.names = names
            self.frames = np.zeros((count, 4, 3))
            self.measured = np.full((count, bounds.RESULT_COLUMNS), np.inf)
        self.table: Array = all_bodies[:count]
        self.links = links
        self.shift(self._shift)
        if others:  # compiled code reads a row for each body
            self.frames_then = self.frames.copy()
        return others

    def shift(self, by: Array) -> None:
        """Moves the bodies by a vector (3,) [m] from where scene and links have them, or those of the scene alone."""
        self._shift = by
        self.table[: self._fixed, 4:7] = self._origins[: self._fixed] + by
        self.moved_links = self.links.copy()
        if not self.standing:
            self.moved_links[:, :3] += by
        surface.place_bodies(self.table, self.moved_links, self.frames)

    @property
    def smooth(self) -> Bodies:
        """The same without friction."""
        return self.kernel._replace(rough=np.zeros(len(self.table)))

    @property
    def kernel(self) -> Bodies:
        """As the compiled solver takes them."""
        return Bodies(
            self.table, self.frames, self.frames_then, self.triangles, self.tree, self.stack, self.moved_links,
            self.measured, self.counts, self.rough[: len(self.table)],
        )  # fmt: skip

    def rows_of(self, name: str) -> list[int]:
        """The rows of a body, of a divided one those of its parts."""
        return [row for row, other in enumerate(self.names) if other == name]

    def deviation(self, touches: Array) -> float:
        """[m], how far the bodies of contacts (k, TOUCH) are at most off what they are in place of."""
        rows = touches[:, 1].astype(int)
        return float(self._off[rows[rows < len(self.names)]].max(initial=0.0))

    def remember(self) -> None:
        """Where they are is where they were at the last solution."""
        self.frames_then = self.frames.copy()
        self.links_then = self.links
