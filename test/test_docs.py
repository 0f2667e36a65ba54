"""The pages and the README: all that they name exists, and what they show works."""

import contextlib
import re
import runpy
import shlex
import subprocess
import sys
import time
from functools import cache
from importlib import import_module
from itertools import pairwise
from pathlib import Path
from typing import Any

import pytest
import rclpy
import yaml
from PIL import Image
from rclpy.context import Context
from ros_processes import PATIENCE

from eulerparams_control.command_line import executables
from eulerparams_control.control.mode import Cause
from eulerparams_control.lab.experiments.faulty import read_faults
from eulerparams_control.lab.run.processes import Nodes
from eulerparams_control.parameters.fields import fields_of, from_mapping
from eulerparams_control.resources import config_names
from eulerparams_control.robot.catalogue import load_robot
from eulerparams_control.ros.arm_launch import load_arm
from sim_bridge.bridge_parameters import BridgeParameters
from sim_bridge.drive_modes import DriveCause
from sim_bridge.environment import nest, read_environment

ROOT = Path(__file__).resolve().parents[1]
PAGES = {path.name: path.read_text() for path in (ROOT / "README.md", *ROOT.glob("docs/*.md"))}
SITE = runpy.run_path(str(ROOT / "tools" / "site.py"))
PARAMETERS: dict[str, Any] = SITE["PARAMETERS"]
BLOCK = re.compile(r"(?m)^```(\w+)\n((?s:.*?))^```$")
MADE_HERE = {"tool.yaml", "my_arm.yaml", "my_arm", "my_driver"}  # by what a page shows before
BLOCKS = [found for words in PAGES.values() for found in BLOCK.findall(words)]
BAG = "out/demo"  # blocks that read it need a run


def each_block(kind: str, *, of_bag: bool = False) -> pytest.MarkDecorator:
    found = [text for of, text in BLOCKS if of == kind and (BAG in text) == of_bag]
    return pytest.mark.parametrize("text", found)


def commands() -> set[str]:
    """Return the lines of a shell about this package, in blocks, indented, or in a sentence."""
    shown = [text for kind, text in BLOCKS if kind == "bash"]
    for rest in (BLOCK.sub("", words) for words in PAGES.values()):
        shown += re.findall(r"(?m)^    +(\S.*(?:\\\n.*)*)", rest)
        shown += re.findall(r"`((?:ros2|make|experiment|analyze) [^`]+)`", rest)
    lines = "\n".join(shown).replace("\\\n", " ").splitlines()
    ours = {"ros2", "make", "python", "python3", *executables()}
    told = {" ".join(line.split()) for line in lines if "..." not in line}
    told = {line for line in told if line and Path(line.split()[0]).name in ours}
    return {line for line in told if len(line.split()) > 3 or "ros2" not in line}  # no name alone


@cache
def interface() -> dict[str, set[str]]:
    """Return the topics and services of each node by the page of the nodes."""
    rows = re.findall(r"(?m)^\| `(\w+)` \|(.*\|.*\|.*)\|$", PAGES["nodes.md"])
    return {node: set(re.findall(r"`([~\w/]+)`", cells)) for node, cells in rows}


def check_parameters(node: str, given: dict[str, Any]) -> None:
    around = {name: value for name, value in given.items() if name.startswith("environment.")}
    from_mapping(PARAMETERS[node], {k: v for k, v in given.items() if k not in around})
    read_environment(nest({k.removeprefix("environment."): v for k, v in around.items()}))


def check_node(name: str, words: list[str]) -> None:
    if "--ros-args" not in words:
        known = SITE["options"](name) if name in SITE["TOOLS"] else "--recover --help"
        assert all(word in known for word in words if word.startswith("--"))
        names = [word for word in words if name == "experiment" and re.fullmatch(r"[a-z]\w+", word)]
        assert set(names) <= {*config_names("experiments"), "out"}
        return
    given = {}
    for flag, word in pairwise(words):
        key, _, value = word.partition(":=")
        if flag == "--params-file" and word not in MADE_HERE:
            assert (ROOT / word).is_file(), word
        elif flag == "-p":
            given[key] = yaml.safe_load(value)
        elif flag == "-r" and key != "__ns":
            assert key in interface()[name], key
    check_parameters(name, given)


def check_topic(verb: str, words: list[str]) -> None:
    name, *more = (word for word in words if word[0] != "-" and word != "transient_local")
    *node, last = name.strip("/").split("/")
    known = {topic.strip("/") for topics in interface().values() for topic in topics}
    assert (f"~/{last}" in interface()[node[0]]) if node else (last in known), name
    if verb != "echo":
        package, kind, of = more[0].split("/")
        message = getattr(import_module(f"{package}.{kind}"), of)
        if verb == "pub":
            fill(message(), yaml.safe_load(more[1]))


def fill(message: Any, values: dict[str, Any]) -> None:
    for name, value in values.items():
        if isinstance(value, dict):
            fill(getattr(message, name), value)
        else:
            setattr(message, name, value)  # which checks the type


def check_ros2(kind: str, first: str, *rest: str) -> None:
    """Check a command of ROS 2, as far as it is about this package."""
    if kind == "run" and first == "eulerparams_control":
        assert rest[0] in executables()
        check_node(rest[0], list(rest[1:]))
    elif kind == "launch" and first == "eulerparams_control":
        text = (ROOT / "launch" / "bringup.launch.py").read_text()
        assert (ROOT / "launch" / rest[0]).is_file()
        assert all(f'    "{word.partition(":=")[0]}": (' in text for word in rest if ":=" in word)
    elif kind == "param" and first == "set":
        node, name, value = rest[0].strip("/"), *rest[1:]
        assert fields_of(PARAMETERS[node])[name].metadata["live"]
        check_parameters(node, {name: yaml.safe_load(value)})
    elif (kind, first) in (("topic", "pub"), ("topic", "echo"), ("service", "call")):
        check_topic(first, list(rest))


@pytest.mark.parametrize("line", sorted(commands()))
def test_a_command_names_what_exists(line):
    program, *words = shlex.split(line, comments=True)
    name = Path(program).name
    if name == "make":
        targets = set(re.findall(r"(?m)^([\w-]+):", (ROOT / "Makefile").read_text()))
        assert {word for word in words if "=" not in word} <= targets
    elif name == "ros2":
        check_ros2(*words)
    elif name.startswith("python"):
        assert words[0] == "-m" or (ROOT / words[0]).is_file()
    else:
        check_node(name, words)


@each_block("yaml")
def test_a_block_of_yaml_is_read_by_what_it_is_for(text, tmp_path):
    content = yaml.safe_load(text)
    if "urdf" in content:
        (tmp_path / "my_arm.yaml").write_text(text)
        load_robot(str(tmp_path / "my_arm.yaml"))
    elif "controllers" in content:
        (tmp_path / "my_driver.yaml").write_text(text)
        load_arm(str(tmp_path / "my_driver.yaml"))
    elif "faults" in content:
        assert len(read_faults("page", content | {"duration": 5.0})) == len(content["faults"])
    elif "ros__parameters" in content["/**"]:
        given = content["/**"]["ros__parameters"]
        read_environment(given.pop("environment", {}))
        from_mapping(BridgeParameters, given)
    else:
        assert "controller_manager" in content["/**"]  # of ros2_control


def run_block(text: str, folder: Path) -> None:
    robot = next(text for _, text in BLOCKS if text.startswith("urdf:"))
    (folder / "my_arm.yaml").write_text(robot)
    with contextlib.chdir(folder):
        exec(compile(text, "page", "exec"), {"__name__": "page"})


@each_block("python")
def test_a_block_of_python_runs(text, tmp_path):
    run_block(text, tmp_path)


@pytest.mark.slow
@each_block("python", of_bag=True)
def test_a_block_of_python_that_reads_the_demo_runs(text, tmp_path):
    tool = Path(sys.executable).with_name("experiment")
    variant = ["--variant", "clik_euler_parameters", "--out", tmp_path / "out"]
    subprocess.run([tool, "demo", *variant], check=True, capture_output=True)
    run_block(text, tmp_path)


@pytest.mark.parametrize("page", PAGES)
def test_each_link_leads_to_a_file_and_to_a_heading_of_it(page):
    folder = ROOT if page == "README.md" else ROOT / "docs"
    for target in re.findall(r"\]\(([^)\s]+)\)", BLOCK.sub("", PAGES[page])):
        path, _, anchor = target.partition("#")
        file = folder / (path or page)
        assert file.exists(), target
        if anchor:
            headings = re.findall(r"(?m)^#+ (.*)$", BLOCK.sub("", file.read_text()).lower())
            slugs = {re.sub(r"[^\w\- ]", "", words).replace(" ", "-") for words in headings}
            assert anchor in slugs, target


@cache
def vocabulary() -> set[str]:
    rooms = ("eulerparams_control", "sim_bridge", "config", "launch", "examples", "benchmarks",
             "test", "tools")  # fmt: skip
    files = {path for room in rooms for path in (ROOT / room).rglob("*")}
    found = {path for path in files if path.suffix in (".py", ".yaml", ".html")}
    others = {ROOT / "setup.py", ROOT / "package.xml"}
    texts = [path.read_text() for path in (found | others) - {Path(__file__)}]
    return MADE_HERE | set(re.findall(r"\w+", " ".join([*texts, *map(str, found)])))


@pytest.mark.parametrize("page", sorted(PAGES.keys() - {"robots.md"}))  # it names drivers
def test_each_name_in_code_is_one_of_the_sources_and_each_path_exists(page):
    for code in re.findall(r"`([^`\n]+)`", BLOCK.sub("", PAGES[page])):
        for name in re.findall(r"_?[a-z]+_\w*[a-z\d]", code):
            assert {name, name.upper()} & vocabulary(), code
        for path, name in re.findall(r"([\w/]+\.py)::(?:\w+\.)?(\w+)", code):
            source = (ROOT / ("" if "/" in path else "test") / path).read_text()
            assert re.search(rf"(def|class) {name}\b", source), code
        if re.fullmatch(r"(config|launch|docs|test|tools|benchmarks|examples)/[a-z_./]+", code):
            assert (ROOT / code).exists(), code


def test_each_cause_has_its_section_and_its_remedy():
    page = PAGES["troubleshooting.md"]
    causes = sorted(cause.value for cause in Cause if cause is not Cause.NONE)
    _, _, rest = page.partition("\n## Causes\n")
    sections, _, robot = rest.partition("\n## Causes of the simulated robot\n")
    assert sorted(re.findall(r"(?m)^### `(\w+)`$", sections)) == causes
    assert sorted(re.findall(r"<!-- remedy: (\w+)", sections)) == causes
    assert sorted(SITE["remedies"]()) == causes
    rows = " ".join(re.findall(r"(?m)^\| (`.*?) \|", robot.partition("\n## ")[0]))
    assert set(re.findall(r"`(\w+)`", rows)) - {"cause"} == set(DriveCause) - {DriveCause.NONE}


def test_the_readme_is_short_shows_what_moves_and_says_what_ci_runs():
    text = PAGES["README.md"]
    assert len(text.splitlines()) <= 120
    picture = ROOT / re.findall(r"\]\((.*webp)\)", text)[0]
    assert picture.stat().st_size < 2e6
    assert Image.open(picture).n_frames > 30
    ran = re.findall(r"(?m)^make [\w-]+$", (ROOT / ".ci" / "run").read_text())
    assert ran
    assert all(line in " ".join(text.split()) for line in ran)


USUAL = {"parameter_events", "rosout", "driver_effort", "clock", "tf", "~/transition_event"}
SERVED = {"std_srvs/srv/Trigger", "visualization_msgs/srv/GetInteractiveMarkers"}
ANY = {"joint_reference", "joint_effort"}  # by the parameter ``control``


@pytest.mark.slow
def test_the_page_of_nodes_has_the_topics_and_services_that_they_have(tmp_path):
    others = {"teleop", "bag_recorder", "fault_injector"}  # whose topics are parameters
    context = Context()
    with Nodes(tmp_path) as nodes:
        rclpy.init(context=context, domain_id=int(nodes.environment["ROS_DOMAIN_ID"]))
        look = rclpy.create_node("look", context=context)

        def has(name: str) -> set[str]:
            found = []
            with contextlib.suppress(rclpy.node.NodeNameNonExistentError):
                found += look.get_subscriber_names_and_types_by_node(name, "/")
                found += look.get_publisher_names_and_types_by_node(name, "/")
                served = look.get_service_names_and_types_by_node(name, "/")
                found += [each for each in served if each[1][0] in SERVED]
            return {re.sub(f"^/{name}/", "~/", topic).lstrip("/") for topic, _ in found} - USUAL

        ours = [name for name in interface() if name in PARAMETERS.keys() - others]
        said = {name: {topic.lstrip("/") for topic in interface()[name]} - USUAL for name in ours}
        for name in said:
            nodes.start(name, {"control": "torque"} if name == "pybullet_bridge" else {})
        end = time.monotonic() + PATIENCE
        for name, topics in said.items():
            while not topics - ANY <= has(name) and time.monotonic() < end:
                time.sleep(0.05)  # then look again
            assert has(name) - ANY == topics - ANY, name
        look.destroy_node()
    context.try_shutdown()


@pytest.mark.slow
def test_the_site_is_built_without_a_warning_and_is_searched_without_a_network(browser, tmp_path):
    tool = Path(sys.executable).with_name("mkdocs")
    build = [tool, "build", "--strict", "--site-dir", tmp_path]
    subprocess.run(build, cwd=ROOT, check=True)
    page, asked = browser.new_page(), []
    page.on("request", lambda request: asked.append(request.url))
    page.goto((tmp_path / "nodes.html").as_uri())
    page.keyboard.press("/")
    page.keyboard.type("max_latency")
    page.wait_for_selector(".md-search-result__item", timeout=1e3 * PATIENCE)
    assert all(url.startswith("file:") for url in asked), asked
