"""Many endings of one delivery: at some moment the process forks, and each child goes on with its own fault.

What comes before the fault is flown once. A child has a copy of the whole world, supervisor included, so its end is the same, bit for
bit, as that of a delivery of its own.
"""

from __future__ import annotations

import os
import pickle
import shutil
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any, Generic, NoReturn, TypeVar

if TYPE_CHECKING:
    from collections.abc import Callable, Hashable
    from pathlib import Path

    from benchmarks.link.deliveries import Stage

Case = TypeVar("Case")


@dataclass(frozen=True)
class Died:
    """How a branch ended that came to no judgement.

    Attributes
    ----------
    reason : str
        The exception.
    """

    reason: str
    kind: str = "died"


@dataclass
class Branches(Generic[Case]):
    """The faults that are still to be thrown in, by the moment at which they begin, and how the others ended.

    Attributes
    ----------
    waiting : dict
        Faults by moment.
    ended : dict
        Result by fault; `Died` for one whose delivery ended in an exception.
    mine : Case or None
        In a child: its fault.
    """

    waiting: dict[Hashable, list[Case]]
    folder: Path
    ended: dict[Case, Any] = field(default_factory=dict)
    mine: Case | None = None
    _pipe: int = -1

    def at(self, moment: Hashable, stage: Stage) -> Case | None:
        """Fork for every fault that begins at this moment; returns the fault in its child, None in the parent."""
        for case in self.waiting.pop(moment, ()) if self.mine is None else ():
            read, write = os.pipe()
            child = os.fork()
            if child == 0:
                os.close(read)
                self.mine, self._pipe = case, write
                self._move_journal(stage)
                return case
            os.close(write)
            with os.fdopen(read, "rb") as told:
                answer = told.read()
            os.waitpid(child, 0)
            self.ended[case] = pickle.loads(answer) if answer else Died("it told nothing")
        return None

    def _move_journal(self, stage: Stage) -> None:
        """Go on writing in a journal of one's own."""
        number = os.getpid()
        path = self.folder / f"branch-{number}.jsonl"
        shutil.copyfile(stage.journal_path, path)
        stage.journal_path = path
        if stage.supervisor is not None:
            journal = stage.supervisor.context.journal
            journal.path, journal.resume = path, True
            journal.close()
            journal.__post_init__()

    def fly(self, run: Callable[[], Any]) -> dict[Case, Any]:
        """Fly the delivery once, with all its branches; `run` ends a child's delivery and judges it."""
        try:
            result = run()
        except BaseException as error:
            if self.mine is None:
                raise
            result = Died(f"{type(error).__name__}: {error}")
        if self.mine is not None:
            self._leave(result)
        assert not self.waiting, f"moments that never came: {list(self.waiting)}"
        return self.ended

    def _leave(self, result: Any) -> NoReturn:
        with os.fdopen(self._pipe, "wb") as tell:
            pickle.dump(result, tell)
        os._exit(0)
