"""Shared by the executables: the console, events, interrupts."""

import gc
import io
import subprocess
import sys
from unittest.mock import Mock

import pytest
import yaml
from in_process import class_of, module_of
from rich.console import Console
from rich.text import Text

from eulerparams_control import command_line, events
from eulerparams_control.command_line import say
from eulerparams_control.events import ExitCode
from eulerparams_control.parameters.fields import fields_of
from eulerparams_control.parameters.schemes import schemes
from eulerparams_control.ros import runtime

NODES = (*schemes(), "identify_tool", "pybullet_bridge", "watchdog")


def test_a_line_is_printed_as_it_is_however_long_it_is():
    out = io.StringIO()
    text = "[bold]no markup[/bold] " + "x" * 300
    say(Console(file=out, width=80), text)
    say(Console(file=out, width=80), Text(text))
    assert out.getvalue() == f"{text}\n" * 2


@pytest.mark.parametrize("option", ["-h", "--help"])
@pytest.mark.parametrize("name", NODES)
def test_a_node_says_what_it_is_and_all_its_parameters(name, option, monkeypatch, capsys):
    monkeypatch.setattr("sys.argv", [f"/somewhere/{name}"])
    monkeypatch.setenv("COLUMNS", "60")
    assert module_of(name).main([option]) == 0
    printed = capsys.readouterr().out
    assert printed.startswith(f"usage: {name} [--ros-args")
    lines = printed.splitlines()
    assert f"The node {name}" in printed
    assert max(len(line) for line in lines if line.startswith(6 * " ")) <= 60
    monkeypatch.setenv("COLUMNS", "5")  # too narrow for any word
    assert module_of(name).main([option]) == 0
    for field in fields_of(class_of(name).parameters_type).values():
        star = "*" if field.metadata["live"] else ""
        (at,) = (k for k, line in enumerate(lines) if line.startswith(f"  {field.name}{star}: "))
        assert lines[at + 1].split()[0] == field.metadata["description"].split()[0]


@pytest.mark.parametrize("is_terminal", [False, True])
def test_events_are_told_to_programs_and_not_to_a_terminal(is_terminal, monkeypatch, capsys):
    monkeypatch.setattr(events, "_tells", False)
    monkeypatch.setattr("sys.stdout.isatty", lambda: is_terminal)
    events.begin()
    events.tell(events.Event.READY)
    assert len(events.events_of(capsys.readouterr().out)) == (not is_terminal)


def test_an_interrupt_while_modules_are_imported_ends_in_silence(monkeypatch, capsys):
    def interrupted(_: str) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(command_line, "import_module", interrupted)
    assert command_line.clik() == 130
    assert capsys.readouterr() == ("", "")
    assert gc.isenabled()


def test_a_program_that_there_is_not_ends_with_the_names_of_those_that_there_are():
    for given in ([], ["clk"]):
        command = [sys.executable, "-m", "eulerparams_control.command_line", *given]
        done = subprocess.run(command, check=False, capture_output=True, text=True)
        assert done.returncode == 1
        assert done.stderr.startswith("error: expected the name of a program: analyze, ")
        assert "Traceback" not in done.stderr


def test_an_argument_without_ros_args_before_it_is_refused():
    code, text = runtime._run(Mock(), ["orientation:=euler_angles", "--ros-args"])
    assert code is ExitCode.ERROR
    assert "'orientation:=euler_angles' does nothing without --ros-args before it" in text


@pytest.mark.parametrize(
    "urdf",
    [
        '<robot name="a">\n <!-- x: y -->\n</robot>',
        ' <?xml version="1.0"?>\n<robot name="a">\n<!-- # 3 -->\n</robot>',
    ],
)
def test_a_urdf_that_is_no_yaml_is_refused_with_the_commands_that_make_a_parameter_file(
    urdf, tmp_path
):
    code, text = runtime._run(Mock(), ["--ros-args", "-p", f"robot_description:={urdf}"])
    assert code is ExitCode.ERROR
    assert "is no YAML value" in text
    assert "<!--" not in text
    (tmp_path / "FILE.urdf").write_text(urdf)
    subprocess.run(text.partition("made by: ")[2], shell=True, check=True, cwd=tmp_path)
    made = yaml.safe_load((tmp_path / "robot.yaml").read_text())
    assert made["/**"]["ros__parameters"]["robot_description"].split() == urdf.split()
