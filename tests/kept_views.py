"""Rendering processes that several tests use one after the other, because each start takes half a second."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator

import pytest

from betterbench.sim.scenes.limited import LimitedView


class KeptView(LimitedView):
    """A process that lives on after its context, unless it is within an answer."""

    is_free = False
    _idle = True

    def sights(self, qpos, *, jitter):
        self._idle = False
        yield from super().sights(qpos, jitter=jitter)
        self._idle = True

    def forget_scene(self) -> None:
        """Opens the next scene anew, even if it has the name of the last one, because tests change files."""
        self._opened = None

    def close(self) -> None:
        self.is_free = True
        if not self._idle:
            super().close()


class KeptViews:
    """Stands for :class:`LimitedView` in a module. Views that are used at the same time are different processes."""

    def __init__(self) -> None:
        self._made: list[KeptView] = []

    def __call__(self, *, quality: str, size: int = 256) -> KeptView:
        for view in self._made:
            if view.is_free and not view.is_closed:
                view.set_look(quality=quality, size=size)
                view.forget_scene()
                break
        else:
            view = KeptView(quality=quality, size=size)
            self._made.append(view)
        view.is_free = False
        return view

    def end(self) -> None:
        for view in self._made:
            LimitedView.close(view)


@contextlib.contextmanager
def used_by_commands(kept: KeptViews) -> Iterator[None]:
    """Lets the commands that draw stored scenes use the processes again."""
    from betterbench.demonstrations.export import pictures
    from betterbench.evaluation.figures import films, views
    from betterbench.sim.modalities import run, viewing
    from betterbench.sim.scenes import limited

    with pytest.MonkeyPatch.context() as patch:
        for module in (films, views, viewing, run, pictures, limited):
            patch.setattr(module, "LimitedView", kept)
        yield
