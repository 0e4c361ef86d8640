"""Edits that have been done and undone."""

from dataclasses import dataclass

from neural_strands.editing.settings import Edit, Wind


@dataclass(frozen=True)
class History:
    """A list of edits, and the position in it up to which they are applied.

    Attributes:
        done: applied edits, oldest first.
        undone: undone edits, the next to redo first.
    """

    done: tuple[Edit, ...] = ()
    undone: tuple[Edit, ...] = ()

    def with_edit(self, edit: Edit) -> "History":
        """Apply one more edit; undone ones are forgotten.

        A wind replaces a wind just before it, because only the last one counts.
        """
        replaces = isinstance(edit, Wind) and bool(self.done) and isinstance(self.done[-1], Wind)
        return History((*(self.done[:-1] if replaces else self.done), edit))

    def back(self) -> "History":
        """Undo the last edit, if there is one."""
        return History(self.done[:-1], (self.done[-1], *self.undone)) if self.done else self

    def forward(self) -> "History":
        """Redo the edit that was undone last, if there is one."""
        return History((*self.done, self.undone[0]), self.undone[1:]) if self.undone else self

    def cleared(self) -> "History":
        """Undo all edits."""
        return History((), (*self.done, *self.undone))
