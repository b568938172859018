"""Cables and bodies as edits have left them, in a process beside the node: :class:`Following`."""

from __future__ import annotations

import threading
from typing import final

from cable_shape.errors import ArgumentError, InputError
from cable_shape.prediction.layout import Laid, Layout
from cable_shape.viewer.mailbox import Mailbox

#: A letter for a layout that is too long for one.
TOO_LONG = b""


@final
class Following:
    """What the node's edits have made of all that there was at configure, as of now.

    Parameters
    ----------
    layout : Layout
        At configure.
    news : int, optional
        Descriptor of a mailbox, see :meth:`cable_shape.ros.worker.WorkerProcess.tell`. Default: nothing is edited.
    """

    def __init__(self, layout: Layout, news: int | None = None) -> None:
        self.first = self._layout = layout
        self._mailbox = None if news is None else Mailbox(news)
        self._read, self._known = 0, True
        self._one_reads = threading.Lock()

    @property
    def layout(self) -> Layout:
        """The newest that the node has told.

        Raises
        ------
        InputError
            If it was too long to be told.
        """
        with self._one_reads:
            letter = None if self._mailbox is None else self._mailbox.take(self._read)
            if letter is not None:
                self._read, text = letter
                self._known = text != TOO_LONG
                if self._known:
                    self._layout = Layout.read(text.decode(), self.first.harnesses)
            if not self._known:
                raise InputError(
                    "what edits have made of the scene is too long to be known here. Clean the node up, and configure "
                    "it with the scene as it is now."
                )
            return self._layout

    def held_as_made(self, name: str) -> Laid:
        """A cable, or a segment, that grips hold at both its ends and that lies in the clips it was configured in.

        Raises
        ------
        ArgumentError
            If edits have left it otherwise.
        """
        laid, first = self.layout.cables[name], self.first.cables[name]
        whole = (laid.first, laid.last, laid.opened) == (0.0, laid.made.length, "")
        if not whole or laid.clips != first.clips or laid.masses != first.masses:
            held = f"held from {laid.first:g} to {laid.last:g} m, in {len(laid.clips)} clips" + (
                f", its {laid.opened} open" if laid.opened else ""
            )
            bound = "edits have left it otherwise than its file says, and it is calibrated as that says"
            remedy = "Bring it back by edits, or clean the node up and configure it with a cable's file as it is now."
            raise ArgumentError.of(f"cable {name!r}", held, bound, remedy)
        return laid
