"""Rendering processes that several tests use one after the other, because each start takes half a second."""

from __future__ import annotations

from betterbench.sim.scenes.limited import LimitedView


class KeptView(LimitedView):
    """A process that lives on after its context, unless it is within an answer."""

    is_free = False
    _idle = True

    def sights(self, qpos, *, jitter):
        self._idle = False
        yield from super().sights(qpos, jitter=jitter)
        self._idle = True

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
                break
        else:
            view = KeptView(quality=quality, size=size)
            self._made.append(view)
        view.is_free = False
        return view

    def end(self) -> None:
        for view in self._made:
            LimitedView.close(view)
