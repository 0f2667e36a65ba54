"""The controls beside the scene: what each does is said in a sentence."""

import html
import math
import time
from collections import deque
from collections.abc import Callable, Sequence
from functools import partial
from typing import Any

import numpy as np
import viser

from eulerparams_control.control.mode import Cause, Mode
from eulerparams_control.laws.orientation import ORIENTATIONS, SEQUENCES
from eulerparams_control.laws.orientation.sequences import EulerSequence
from eulerparams_control.laws.rotations import angle_between
from eulerparams_control.live.desk import HELD, KEPT, Deed, Order
from eulerparams_control.live.view import View
from eulerparams_control.messages.keys import Lifecycle
from eulerparams_control.parameters.fields import fields_of, is_list
from eulerparams_control.parameters.schemes import SchemeInfo

PLOTS_WIDTH = 300  # [pixels]
AXES = ("x", "y", "z", "about x", "about y", "about z")
BASE, TOOL = "base", "tool"
_HOLD_HZ = 20.0
_SECONDS, _PERIOD = 20.0, 0.1  # of the plots, and between two samples
_SETTLES = 1.0  # [s] after which a slider that somebody moved shows what the node says
_COMPLIANCE = ("K_p", "damping_ratio_p", "K_o", "damping_ratio_o")
_LOOP = ("k_Pp", "k_Vp", "k_Po", "k_Vo")
_RANGE = 3.0  # times the value at first

_DOING = {
    Mode.WAITING: "waits for its first target",
    Mode.HOLDING: "holds its pose",
    Mode.FOLLOWING: "follows its target",
    Mode.STOPPED: "is stopped and holds its joints",
    Mode.RELEASING: "is let come to rest",
    Mode.DISTRUSTING: "gets no commands until its states go on steadily",
    Lifecycle.UNCONFIGURED: "has no controller yet: it is starting",
    Lifecycle.INACTIVE: "is not controlled: the controller is not active",
    Lifecycle.FINALIZED: "is not controlled: the controller has ended",
    "": "is not known yet: waiting for the controller",
}
_COLOURS = ("#2b8a3e", "#e67700", "#e03131")
_BOX = (
    '<div style="border-left:4px solid {};padding:0 0 0 10px;margin:8px 10px;min-height:4.8em;'
    'font-size:0.85em;line-height:1.4">{}</div>'
)
_LOOK = """<style>
.mantine-NumberInput-root { width: 4.5rem !important; flex-shrink: 0; }
.mantine-Slider-markLabel { font-size: 0.75rem !important; }
</style>"""
"""The box beside a slider shows six digits, and the ends of a slider are large enough to read."""

_LINE = '<div style="padding:4px 14px;font-size:0.8em;opacity:0.8">{}</div>'

_LINES = ("desired to tool", "#1c7ed6"), ("compliant to tool", "#e67700")
_PLOTS = (
    ("position error [mm]", _LINES, 1.0),
    ("orientation error [deg]", _LINES, 0.5),
    ("fastest joint [rad/s]", (("joint", "#c2255c"),), 0.2),
    ("distance to the pole [deg]", (("tool", "#7048e8"),), 10.0),
)
"""Title, lines with their colours, and the least that the highest value on the axis may be."""

_PASS = """**Pass the pole of the Euler angles.** Where the purple needle meets a red pole, the law
of `euler_angles` (tab Law) is singular: there the tool is lost, or the arm stops.
`euler_parameters` have no such place. Go next to the pole, then through it, with each."""

_FAR = (
    ("Go next to the pole", Deed.APPROACH, "Turns the tool to 20 deg before a pole."),
    ("Through the pole", Deed.PASS, "Turns it through the pole to 20 deg beyond."),
    ("Back to the start", Deed.HOME, "To the pose in which this page found the arm."),
)
"""Label, order and hint of what only a simulated arm does."""


class LivePanel:
    """The controls of all pages, which show the same.

    Args:
        server: of the pages.
        scheme: of the controller.
        title: of the page.
        put: takes the orders; called from other threads.
    """

    def __init__(
        self, server: viser.ViserServer, scheme: SchemeInfo, title: str,
        put: Callable[[Order], None],
    ) -> None:  # fmt: skip
        self._gui, self._scheme, self._put = server.gui, scheme, put
        self._fields = fields_of(scheme.parameters)
        self._defaults: dict[str, Any] = {n: f.default for n, f in self._fields.items()}
        self._inputs: dict[str, list[Any]] = {}
        self._touched: dict[str, float] = {}
        self._shown: dict[str, Any] = {}  # and the touch after which it was
        self._settled: dict[str, float | None] = {}
        self._samples: deque[tuple[float, ...]] = deque(maxlen=round(_SECONDS / _PERIOD))
        self._next = 0.0
        gui = self._gui
        gui.configure_theme(show_logo=False, show_share_button=False, control_width="large")
        gui.set_panel_label(title)
        gui.main_panel.dock_right()
        gui.add_html(_LOOK)
        self._state = gui.add_html("")
        self._people = gui.add_html("")
        self._button(
            "Halt", Deed.HALT, "Brakes the arm along its path; only Resume leads on.", "red"
        )
        self._button(
            "Resume", Deed.RESUME, "Goes on after a halt or a fault, from where the arm is."
        )
        gui.add_html(
            _LINE.format(
                "<b>Halt</b> brakes the arm along its path. <b>Resume</b> goes on after a halt "
                "or a fault, from where the arm is.<br><br>"
            )
        )
        tabs = gui.add_tab_group()
        with tabs.add_tab("Move"):
            self._build_move()
        with tabs.add_tab("Push"):
            self._build_push()
        with tabs.add_tab("Law"):
            self._build_law()
        self._build_plots()

    # --- what it is made of --------------------------------------------------------------

    def _say(self, text: str) -> None:
        self._gui.add_markdown(text)

    def _button(
        self, label: str, deed: Deed, says: str, colour: Any = None
    ) -> viser.GuiButtonHandle:
        button = self._gui.add_button(label, hint=says, color=colour)
        button.on_click(lambda event: self._order(event, deed))
        return button

    def _hold(self, label: str, deed: Deed, value: Callable[[], Any], says: str) -> Any:
        button = self._gui.add_button(label, hint=says)
        button.on_hold(lambda event: self._order(event, deed, value()), callback_hz=_HOLD_HZ)
        return button

    def _order(self, event: Any, deed: Deed, value: Any = None) -> None:
        if event.client_id is not None:  # not from ourselves
            self._put(Order(event.client_id + 1, deed, value))

    def _build_move(self) -> None:
        gui = self._gui
        self._say(
            "**Drag the target**, the arrows and arcs at the tool: the arm goes there smoothly, "
            "within its limits."
        )
        self._slider("speed_override", 0.0, 1.0, 0.01, "Speed", "1 as asked, 0 halts on the path.")
        self._say("**Jog:** the tool moves while a button is held, and brakes when it is let go.")
        axis = gui.add_dropdown("Along", AXES)
        frame = gui.add_dropdown("Axes of", (BASE, TOOL))
        speed = gui.add_slider("% of the fastest", 1, 100, 1, 30)

        def twist(sign: float) -> tuple[float, int, float, str]:
            return sign, AXES.index(axis.value), sign * speed.value / 100, frame.value

        for sign, label in ((-1.0, "Hold to jog backwards"), (1.0, "Hold to jog forwards")):
            self._hold(
                label, Deed.JOG, partial(twist, sign), f"Stops {HELD:g} s after its release."
            )
        self._far: list[Any] = [self._gui.add_markdown(_PASS)]
        self._far += [self._button(*far) for far in _FAR]

    def _build_push(self) -> None:
        gui = self._gui
        self._say(
            "**Push the simulated tool** as a hand would: with `impedance_control` or "
            "`compliance_control` it gives way like a spring. The orange arrow is what the sensor "
            "feels, the blue ellipsoid the stiffness."
        )
        axis = gui.add_dropdown("Along", AXES)
        force = gui.add_slider("Force [N] or torque [0.1 Nm]", -40.0, 40.0, 1.0, 20.0)

        def push() -> tuple[float, int, float]:
            return 1.0, AXES.index(axis.value), force.value

        self._pushes = [
            self._hold("Hold to push", Deed.PUSH, push, f"Ends {HELD:g} s after its release."),
            gui.add_button(f"Keep pushing for {KEPT:g} s", hint="Ends if this page is closed."),
            gui.add_button("Stop pushing", color="gray"),
        ]
        self._pushes[1].on_click(lambda event: self._order(event, Deed.KEEP, push()))
        self._pushes[2].on_click(lambda event: self._order(event, Deed.RELEASE))
        self._nobody = gui.add_html("")

    def _build_law(self) -> None:
        gui = self._gui
        self._say(f"**The law** of `{self._scheme.name}`, changed while it runs, without a jump.")
        for name, label, options in (
            ("orientation", "Orientation by", ORIENTATIONS),
            ("euler_sequence", "Euler angles", SEQUENCES),
        ):
            choice = gui.add_dropdown(label, tuple(options), disabled=True)
            choice.on_update(partial(self._set, name, 0))
            self._inputs[name] = [choice]
        compliance = [name for name in _COMPLIANCE if name in self._fields]
        if compliance:
            self._say("**Stiffness and damping**: what a push meets.")
        for name in compliance:
            self._sliders(name)
        loop = [name for name in _LOOP if name in self._fields]
        with gui.add_folder("Gains of the motion loop", expand_by_default=not compliance):
            self._say("How fast errors vanish: k_P the springs, k_V the damping of the motion.")
            for name in loop:
                self._sliders(name)
        self._matrices = gui.add_html("")

    def _sliders(self, name: str) -> None:
        """Add one slider for a number, three for a diagonal."""
        field = self._fields[name]
        hint, default = field.metadata["description"], self._defaults[name]
        unit = f" [{field.metadata['unit']}]" if field.metadata["unit"] else ""
        if not is_list(field):
            most = _RANGE * default
            self._slider(name, 0.0, most, most / 100, f"{name}{unit}", hint)
            return
        for number, axis in enumerate("xyz"):
            most = _RANGE * default[number]
            self._slider(name, 0.0, most, most / 100, f"{name} {axis}{unit}", hint)

    def _slider(
        self, name: str, least: float, most: float, step: float, label: str, hint: str
    ) -> None:
        slider = self._gui.add_slider(label, least, most, step, least, hint=hint, disabled=True)
        inputs = self._inputs.setdefault(name, [])
        slider.on_update(partial(self._set, name, len(inputs)))
        inputs.append(slider)

    async def _set(self, name: str, number: int, event: Any) -> None:
        # on the event loop, before the next change
        if event.client_id is not None:
            self._touched[name] = time.monotonic()
            self._order(event, Deed.SET, (name, number, event.target.value))

    def _build_plots(self) -> None:
        panel = self._gui.add_panel()
        panel.dock_left()
        panel.set_width(PLOTS_WIDTH)
        self._plots = []
        with panel.add_tab("Plots of the last 20 s"):
            for title, lines, least in _PLOTS:
                names = lines if "compliant_frame" in self._scheme.outputs else lines[:1]
                series = [viser.uplot.Series(label=name, stroke=c, width=2) for name, c in names]
                t = np.array([-_SECONDS, 0.0])
                self._plots.append(
                    self._gui.add_uplot(
                        (t, *(np.full(2, np.nan) for _ in names)),
                        (viser.uplot.Series(label="t"), *series),
                        title=title,
                        height=170,
                        padding=(10, 16, 0, 0),
                        scales=_scales(least),
                        legend={"show": len(names) > 1, "live": False},
                    )
                )

    # --- what it shows -------------------------------------------------------------------

    def update(self, view: View) -> None:
        """Show what is known now."""
        self._write(self._state, self._state_text(view))
        self._write(self._people, _people(view))
        self._show_values(view)
        for entry in self._far:
            if entry.visible != view.is_simulated:
                entry.visible = view.is_simulated
        for button in self._pushes:
            if button.disabled == view.can_push:
                button.disabled = not view.can_push
        nobody = "" if view.can_push else "Nobody takes external_wrench: it needs the simulation."
        self._write(self._nobody, _LINE.format(nobody) if nobody else "")
        now = time.monotonic()
        if now >= self._next:
            self._next = max(now, self._next + _PERIOD)
            self._plot(view, now)

    @staticmethod
    def _write(handle: Any, text: str) -> None:
        if handle.content != text:
            handle.content = text

    def _state_text(self, view: View) -> str:
        if view.trouble:
            return _BOX.format(_COLOURS[2], f"<b>{html.escape(view.trouble)}</b>")
        words = f"<b>{view.mode or 'starting'}</b>: the arm {_DOING.get(view.mode, view.mode)}."
        if view.cause:
            words += f" Cause: {html.escape(view.cause.replace('_', ' '))}."
        for title, text in (("", view.message), ("What to do: ", what_to_do(view))):
            if text and (view.level or title):
                words += f"<br>{title}{html.escape(text)}."
        if view.robot:
            words += f"<br>Robot: {html.escape(view.robot)}"
        return _BOX.format(_COLOURS[min(view.level, 2)], words)

    def _show_values(self, view: View) -> None:
        now, others = time.monotonic(), []
        for name, inputs in self._inputs.items():
            value = view.parameters.get(name)
            is_list = isinstance(value, Sequence) and not isinstance(value, str)
            values = list(value) if is_list else [value]  # type: ignore[arg-type]
            is_shown = value is not None and len(values) == len(inputs)
            if value is not None and not is_shown:
                others.append(f"{name} has {len(values)} numbers")
            for entry in inputs:
                if entry.disabled == is_shown:
                    entry.disabled = not is_shown
            touched = self._touched.get(name)
            if not is_shown or (touched is not None and now < touched + _SETTLES):
                continue
            if value == self._shown.get(name) and touched == self._settled.get(name):
                continue  # what a page changes meanwhile is not set back before it is heard
            self._shown[name], self._settled[name] = value, touched
            for entry, wanted in zip(inputs, values, strict=True):
                if entry.value != wanted:
                    if hasattr(entry, "max") and wanted > entry.max:
                        entry.max = wanted
                    entry.value = wanted
        text = f"{', '.join(others)}: these sliders cannot show it. Set it at the node."
        self._write(self._matrices, _LINE.format(text) if others else "")

    def _plot(self, view: View, now: float) -> None:
        errors = [math.nan] * 4
        if view.tip is not None:
            for index, frame in enumerate((view.desired, view.compliant)):
                if frame is not None:
                    errors[index] = 1e3 * math.dist(frame.p, view.tip.p)
                    errors[2 + index] = math.degrees(angle_between(frame.R, view.tip.R))
        sequence = EulerSequence(str(view.parameters.get("euler_sequence", "XYZ")))
        pole = math.nan if view.tip is None else sequence.pole_distance(view.tip.R)
        self._samples.append((now, *errors, view.speed, math.degrees(pole)))
        if round(now / _PERIOD) % 3:
            return
        t, *rows = np.array(self._samples).T
        shares = rows[:2], rows[2:4], rows[4:5], rows[5:]
        for plot, shown, (*_, least) in zip(self._plots, shares, _PLOTS, strict=True):
            plot.data = (t - now, *shown[: len(plot.data) - 1])
            most = max(least, float(np.nanmax(np.nan_to_num(shown))))
            top = least * 2.0 ** math.ceil(math.log2(most / least))  # so that it seldom changes
            if plot.scales != (scales := _scales(top)):
                plot.scales = scales


def _scales(top: float) -> dict[str, viser.uplot.Scale]:
    """Return the ranges of a plot whose values go from 0 to ``top``."""
    return {"x": {"time": False, "range": (-_SECONDS, 0.0)}, "y": {"range": (0.0, top)}}


def what_to_do(view: View) -> str:
    """Return the remedy for who has this page: after a halt a button instead of the service."""
    return "press Resume" if view.cause == Cause.HALT else view.remedy


def _people(view: View) -> str:
    if view.pages < 2:
        return ""
    who = "nobody moves the arm" if view.owner is None else f"page {view.owner} moved it last"
    return _LINE.format(
        f"{view.pages} pages are open, {who}. One at a time moves the arm; any may halt it."
    )
