"""Controls of forms, with labels: native elements, for keyboards, screen readers and tablets."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from nicegui import ui

if TYPE_CHECKING:
    from collections.abc import Callable, Sequence


class Field(ui.element, component="static/field.js"):
    """A labelled control.

    Parameters
    ----------
    label : str
        Its label.
    on_change : callable
        Called with the value when a person has changed it.
    kind : str
        ``text``, ``number``, ``listed`` (text with completion), ``select``, ``check``, ``area``, ``range`` or another type of HTML.
    value : str or bool
        Its initial value.
    options : sequence of (value, words)
        Of ``select`` and ``listed``.
    unit, hint : str
        Behind the label, and below the control.
    on_slide : callable, optional
        Called while a ``range`` is dragged.
    extra : str
        Attributes of the control.
    """

    def __init__(
        self,
        label: str,
        on_change: Callable[[Any], Any],
        *,
        kind: str = "text",
        value: str | bool = "",
        options: Sequence[tuple[str, str]] = (),
        unit: str = "",
        hint: str = "",
        on_slide: Callable[[Any], Any] | None = None,
        **extra: str,
    ) -> None:
        super().__init__()
        self._props.update(
            label=label, kind=kind, value=value, options=[list(one) for one in options], unit=unit, hint=hint, error="", extra=extra
        )  # fmt: skip
        self.on("change", lambda event: on_change(event.args))
        if on_slide is not None:
            self.on("slide", lambda event: on_slide(event.args), throttle=0.05)

    @property
    def shown(self) -> Any:
        """The value known to the server."""
        return self._props["value"]

    def show(self, value: str | bool, error: str = "") -> None:  # noqa: FBT001  a value like any other
        """Show a value, and its error."""
        if (self._props["value"], self._props["error"]) != (value, error):
            self._props.update(value=value, error=error)
            self.update()

    def offer(self, options: Sequence[tuple[str, str]]) -> None:
        """Offer other values."""
        self._props["options"] = [list(one) for one in options]
        self.update()

    def measure(self, unit: str) -> None:
        """Show another unit behind the label."""
        self._props["unit"] = unit
        self.update()

    def keep(self, value: Any) -> None:
        """Store a person's input, without sending it back."""
        self._props["value"] = value


class Button(ui.element):
    """A button.

    Parameters
    ----------
    words : str
        Its text.
    on_click : callable
        Its action.
    kind : str
        CSS classes.
    attributes : str
        Others, with underscores for hyphens.
    """

    def __init__(
        self, words: str, on_click: Callable[[], Any] | None = None, kind: str = "", **attributes: str
    ) -> None:
        super().__init__("button")
        self._text = words
        self.classes(kind)
        self._props.update({"type": "button"} | {name.replace("_", "-"): value for name, value in attributes.items()})
        if on_click is not None:
            self.on("click", lambda _: on_click(), args=[])

    def enable(self, enabled: bool) -> None:  # noqa: FBT001
        """Enable or disable it."""
        if enabled:
            self._props.pop("disabled", None)
        else:
            self._props["disabled"] = True
        self.update()


def text(tag: str, words: str, classes: str = "", **attributes: str) -> ui.element:
    """Return an element with a text, which is never read as HTML."""
    made = ui.element(tag).classes(classes)
    made._text = words  # noqa: SLF001  NiceGUI has this for labels only
    made._props.update({name.replace("_", "-"): value for name, value in attributes.items()})  # noqa: SLF001
    return made


def say(element: ui.element, words: str) -> None:
    """Change the text of an element."""
    if element._text != words:  # noqa: SLF001
        element._text = words  # noqa: SLF001
        element.update()


class Status(ui.element):
    """A status line, also for screen readers."""

    def __init__(self) -> None:
        super().__init__("p")
        self.classes("status").props("role=status")

    def tell(self, words: str, *, wrong: bool = False) -> None:
        """Show a text, in place of the last one."""
        self.classes(replace="status wrong" if wrong else "status")
        say(self, words)


class CommandShown:
    """The equivalent command, with a button that copies it.

    Parameters
    ----------
    name : str
        Of the element: ``NAME-command``.
    words : str
        Shown at first.
    """

    def __init__(self, name: str, words: str = "") -> None:
        with ui.element("div").classes("command"):
            self._code = text("code", words, id=f"{name}-command")
            text("button", "Copy", "plain", type="button", data_copy=f"{name}-command")

    def show(self, words: str) -> None:
        """Show another command."""
        say(self._code, words)


class Drop(ui.element, component="static/drop.js"):
    """An area for dropping files; they go to the work folder.

    Parameters
    ----------
    label : str
        Its label.
    accept : str
        Endings, separated by commas.
    on_uploaded, on_refused : callable
        Called with the name of an accepted file, and with the reason for a rejected one.
    """

    def __init__(
        self, label: str, accept: str, on_uploaded: Callable[[str], Any], on_refused: Callable[[str], Any]
    ) -> None:
        super().__init__()
        self._props.update(label=label, accept=accept)
        self.on("uploaded", lambda event: on_uploaded(str(event.args)))
        self.on("refused", lambda event: on_refused(str(event.args)))
