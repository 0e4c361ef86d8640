"""Edits that have been done and undone."""

from dataclasses import dataclass

from neural_strands.editing.settings import Edit, Wind


@dataclass(frozen=True)
class History:
    """A list of edits with a place in it.

    Attributes:
        done: edits in force, oldest first.
        undone: edits taken back, the one to do again first.
    """

    done: tuple[Edit, ...] = ()
    undone: tuple[Edit, ...] = ()

    def with_edit(self, edit: Edit) -> "History":
        """Do one more; what was undone is forgotten.

        A wind takes the place of a wind just before it, because only the last one blows.
        """
        replaces = isinstance(edit, Wind) and bool(self.done) and isinstance(self.done[-1], Wind)
        return History((*(self.done[:-1] if replaces else self.done), edit))

    def back(self) -> "History":
        """Take the last edit back; without one, nothing changes."""
        return History(self.done[:-1], (self.done[-1], *self.undone)) if self.done else self

    def forward(self) -> "History":
        """Do what was taken back last; without any, nothing changes."""
        return History((*self.done, self.undone[0]), self.undone[1:]) if self.undone else self

    def cleared(self) -> "History":
        """Take everything back."""
        return History((), (*self.done, *self.undone))
