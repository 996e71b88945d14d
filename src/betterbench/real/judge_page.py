"""The page of ``better real judge``: the films of one trial, the outcomes with their definitions, and keys."""

from __future__ import annotations

import base64
import threading
from typing import Any

from betterbench.browser.keys import key_table
from betterbench.quoting import markup_text
from betterbench.real.judging import TAP_KEYS, JudgeDesk
from betterbench.real.outcomes import OUTCOMES, outcome_named
from betterbench.review.command_page import PANEL_PX, CommandPage

KEY_ROWS = (
    ("1 … 9, 0", "enter an outcome, and go on"),
    ("Backspace", "take the last entry back"),
    ("← →", "previous, next film"),
    ("Space", "play the film again"),
)
_DONE, _PROBLEM, _PLAIN = "#20bf6b", "#eb3b5a", "#8884"


class JudgePage(CommandPage):
    """The page of one judge."""

    def __init__(self, desk: JudgeDesk, *, host: str, port: int) -> None:
        """Listen, and build the page.

        Raises:
            MissingDependencyError: If viser is not installed.
            InvalidInputError: If the port is taken.
        """
        super().__init__(TAP_KEYS, host=host, port=port, verb="better real judge")
        self._desk = desk
        self._plays = 0  # a film whose markup differs is loaded again
        self._shown: tuple[int, int] | None = None
        gui = self._begin_panel((1.0, 1.0, 1.0), (0.0, 0.0, 0.0))
        self._viser.scene.world_axes.visible = False
        self._films = gui.add_html("")
        self._head = gui.add_html("")
        self._note = self._input(gui.add_text("note", "", hint="Needed for outcome 9."), "text", None)
        self._table = gui.add_html("")
        gui.add_html(key_table(KEY_ROWS))
        self._listen()

    def begin(self) -> None:
        """Show the first film without an entry."""
        self.show()

    def obey(self, command: str, value: Any, stopped: threading.Event) -> None:  # noqa: ANN401 - of the page
        """Execute a command, and show the result."""
        del stopped
        desk = self._desk
        if command in ("next", "previous"):
            desk.step(1 if command == "next" else -1)
        elif command == "undo":
            desk.undo()
        elif command == "again":
            self._plays += 1
        elif command == "complain":
            desk.message, desk.is_problem = str(value), True
        elif command in TAP_KEYS.values():
            before = desk.done, desk.index
            desk.choose(command, str(self._note.value))
            if (desk.done, desk.index) != before:
                self._note.value = ""
        self.show()

    def show(self) -> None:
        """Show the state of the desk; the films only if they changed."""
        with self._viser.atomic():
            if self._shown != (self._desk.index, self._plays):
                self._films.content = films_markup(self._desk.films(), self._plays)
                self._shown = self._desk.index, self._plays
            self._head.content, self._table.content = head_markup(self._desk), outcomes_markup(self._desk.chosen)


def films_markup(films: list[bytes], plays: int) -> str:
    """Return the films of a trial side by side, over the whole page beside the panel, as HTML."""
    share, fit = 100 / max(1, len(films)), "max-height:100%;object-fit:contain"
    videos = "".join(
        f'<video autoplay loop muted controls playsinline style="{fit};width:{share:.1f}%" '
        f'src="data:video/mp4;base64,{base64.b64encode(film).decode("ascii")}"></video>'
        for film in films
    )
    none = "" if films else '<p style="color:#ccc;margin:auto;font-size:16px">This trial has no film.</p>'
    return (
        f'<div data-plays="{plays}" style="position:fixed;left:0;top:0;bottom:0;width:calc(100vw - {PANEL_PX}px);'
        f'background:#15181c;display:flex;align-items:center;z-index:5">{videos}{none}</div>'
    )


def head_markup(desk: JudgeDesk) -> str:
    """Return progress, the instruction and the last message as HTML; nothing tells condition, policy or operator."""
    share = 100.0 * desk.done / len(desk.trials)
    chosen = "" if desk.chosen is None else f" · entered: <b>{markup_text(outcome_named(desk.chosen).title)}</b>"
    color = _PROBLEM if desk.is_problem else _DONE
    return (
        '<div style="padding:4px 10px;font-size:13px;line-height:1.45">'
        f'<div style="opacity:.65;font-size:12px">film {desk.index + 1} of {len(desk.trials)} · {desk.done} judged · '
        f"{markup_text(desk.person)}{chosen}</div>"
        f'<div style="height:4px;background:{_PLAIN};border-radius:2px;margin:4px 0 6px">'
        f'<div style="height:4px;width:{share:.0f}%;background:{_DONE};border-radius:2px"></div></div>'
        f'<div style="opacity:.65;font-size:12px">The arm was told:</div>'
        f'<div style="font-size:15px;font-weight:600">{markup_text(desk.at_hand.header.instruction)}</div>'
        f'<div style="color:{color};min-height:1.4em;margin-top:4px">{markup_text(desk.message)}</div></div>'
    )


def outcomes_markup(chosen: str | None) -> str:
    """Return the outcomes with keys and definitions as HTML, the chosen one marked."""
    rows = "".join(
        f'<tr style="{"background:#20bf6b33" if outcome.name == chosen else ""}">'
        f'<td style="padding:3px 8px 3px 0;vertical-align:top;font-size:15px"><b>{markup_text(outcome.key)}</b></td>'
        f'<td style="padding:3px 0;vertical-align:top"><b>{markup_text(outcome.title)}</b><br>'
        f'<span style="opacity:.75">{markup_text(outcome.definition)}</span></td></tr>'
        for outcome in OUTCOMES
    )
    return (
        '<div style="padding:0 10px;font-size:12px;line-height:1.35">What did the arm do? If several fit, enter the '
        f'first of the list.<table style="margin-top:4px">{rows}</table></div>'
    )
