"""Bags from anyone: read, or refused in one line, within bounds of memory and time.

What random damage does is in ``test_bag_format.py``; here the bytes are chosen by someone who
means harm.
"""

import contextlib
import io
import json
import os
import re
import resource
import struct
import subprocess
import sys
from collections.abc import Callable, Sequence
from functools import cache
from pathlib import Path

import lz4.frame
import numpy as np
import pytest
import yaml
import zstandard
from hypothesis import given
from hypothesis import strategies as st
from mcap.records import Schema
from mcap.writer import CompressionType as Compression
from mcap.writer import Writer
from samples import examples
from synthetic_runs import _TYPES, URDF, write_run

from eulerparams_control.analysis.loading import load
from eulerparams_control.analysis.main import main
from eulerparams_control.bags import Bag, recover
from eulerparams_control.bags.columns import columns
from eulerparams_control.bags.format import BagFlaw, load_yaml
from eulerparams_control.bags.writer import message_definition
from eulerparams_control.errors import BagError
from eulerparams_control.motion.frames import DesiredFrame

JOINT_STATE = "sensor_msgs/msg/JointState"
DEFINITION = message_definition(JOINT_STATE)
MAGIC = b"\x89MCAP0\r\n"
ZEROS = 2**32
MEMORY = 3 * 2**30  # bytes of address space; Python, numpy and Pinocchio take one of them
CPU = 60  # s
PATIENCE = 300  # s; a guard against hanging
LONGEST_LINE = 2000  # characters


# --- the records of an MCAP file, written by hand ------------------------------------------
def record(opcode: int, body: bytes) -> bytes:
    return struct.pack("<BQ", opcode, len(body)) + body


def text(value: str | bytes) -> bytes:
    data = value.encode() if isinstance(value, str) else value
    return struct.pack("<I", len(data)) + data


def schema(
    definition: str | bytes, name: str = JOINT_STATE, encoding: str = "ros2msg", number: int = 1
) -> bytes:
    body = struct.pack("<H", number) + text(name) + text(encoding) + text(definition)
    return record(3, body)


def channel(
    topic: str = "/joint_states", encoding: str = "cdr", profiles: str = "", number: int = 1
) -> bytes:
    metadata = text("offered_qos_profiles") + text(profiles)
    return record(
        4, struct.pack("<HH", number, number) + text(topic) + text(encoding) + text(metadata)
    )


def message(data: bytes, number: int = 1) -> bytes:
    return record(5, struct.pack("<HIQQ", number, 0, 1, 1) + data)


def described(definition: str | bytes) -> bytes:
    """Return a message of joint_states with this definition."""
    return schema(definition) + channel() + message(LONG)


def description(definition: bytes) -> bytes:
    """Return joint_states, and a robot_description of a type that is defined so."""
    own = schema(definition, "std_msgs/msg/String", number=2)
    return described(DEFINITION) + own + channel("/robot_description", number=2) + message(LONG, 2)


def profiled(yaml_text: str) -> bytes:
    return schema(DEFINITION) + channel(profiles=yaml_text)


def chunk(data: bytes, compression: str, size: int) -> bytes:
    head = struct.pack("<QQQI", 0, 10**18, size, 0) + text(compression)
    return record(6, head + struct.pack("<Q", len(data)) + data)


HEAD = MAGIC + record(1, text("ros2") + text("x"))
END = record(15, bytes(4)) + record(2, bytes(20)) + MAGIC


@cache
def zeros(compression: str) -> bytes:
    """Return more zeros than fit into ``MEMORY``, packed; the frame does not say how many."""
    block, count = bytes(2**24), ZEROS // 2**24
    if compression == "zstd":
        packer = zstandard.ZstdCompressor().compressobj()
        return b"".join(packer.compress(block) for _ in range(count)) + packer.flush()
    frame = lz4.frame.LZ4FrameCompressor()
    parts = [frame.begin(), *(frame.compress(block) for _ in range(count)), frame.flush()]
    return b"".join(parts)


def aliases(merged: bool = False) -> str:
    """Return YAML that stands for 10^10 values, by aliases of aliases."""
    first = "{k: 1}" if merged else "[x, x, x, x, x, x, x, x, x, x]"
    lines = [f"a: &a {first}"]
    for above, name in zip("abcdefghi", "bcdefghij", strict=True):
        many = ", ".join([f"*{above}"] * 10)
        lines.append(f"{name}: &{name} {{<<: [{many}]}}" if merged else f"{name}: &{name} [{many}]")
    return "\n".join(lines)


def item(yaml_text: str) -> str:
    return "- " + yaml_text.replace("\n", "\n  ")


def empty_elements(count: int) -> bytes:
    """Return a schema that has an array of types that need no byte."""
    return f"a/B[{count}] x\n{'=' * 80}\nMSG: a/B\n".encode()


LONG = b"\0\1\0\0" + b"\xff" * 8

# What stands between the head and the end of a file; and what is said of it.
BODIES: dict[str, tuple[Callable[[], bytes], str]] = {
    "a chunk of 2^60 bytes": (lambda: struct.pack("<BQ", 6, 2**60), "was not finished"),
    "a zstd bomb that says it is small": (lambda: chunk(zeros("zstd"), "zstd", 9), "the chunk at"),
    "an lz4 bomb": (lambda: chunk(zeros("lz4"), "lz4", ZEROS), "4294967296 bytes unpacked"),
    "an unknown compression": (lambda: chunk(b"x", "bz2", 9), "the compression 'bz2' is unknown"),
    "profiles of aliases": (lambda: profiled(item(aliases())), ""),
    "a type in itself": (lambda: described(f"{JOINT_STATE} x"), ""),
    "empty elements": (lambda: description(empty_elements(2**32 - 1)), ""),
    "a schema of a million lines": (lambda: described("int32 x\n" * 10**6), ""),
    "another encoding": (lambda: schema(DEFINITION) + channel(encoding="json") + message(LONG), ""),
    "many damaged records": (lambda: record(5, b"") * 10**4, "more that is damaged"),
}


def hostile(folder: Path, body: bytes) -> Path:
    folder.mkdir()
    (folder / "x.mcap").write_bytes(HEAD + body + END)
    return folder


# --- within bounds, in a process of their own ----------------------------------------------
# Calls executables one after the other; says the exit code and the output of each as JSON.
CALLS = """
import contextlib, importlib, io, json, sys
for name, *arguments in json.load(sys.stdin):
    with contextlib.redirect_stdout(io.StringIO()) as said, contextlib.redirect_stderr(said):
        code = importlib.import_module(f"eulerparams_control.{name}").main(arguments)
    print(json.dumps([code, said.getvalue()]), flush=True)
"""


def bounded(*calls: Sequence[str]) -> list[tuple[int, str]]:
    """Call executables in a process with little memory and time; return what they said.

    Each ends by itself, and says why in lines and not in a traceback.
    """

    def limit() -> None:
        resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
        resource.setrlimit(resource.RLIMIT_CPU, (CPU, CPU))

    done = subprocess.run(
        [sys.executable, "-c", CALLS],
        input=json.dumps(calls),
        capture_output=True,
        text=True,
        timeout=PATIENCE,
        preexec_fn=limit,
        env=os.environ | {"COLUMNS": "200", "OPENBLAS_NUM_THREADS": "1", "MALLOC_ARENA_MAX": "2"},
    )
    found = [tuple(json.loads(line)) for line in done.stdout.splitlines()]
    assert len(found) == len(calls), (calls[len(found)], done.stderr)
    assert (done.returncode, done.stderr) == (0, "")
    for code, said in found:
        assert code in (0, 1, 2), said
        assert "Traceback" not in said
        assert all(len(line) < LONGEST_LINE for line in said.splitlines())
        assert "\x1b" not in said
        assert not code or "error: " in said
    return found


def analysing(path: Path) -> tuple[str, ...]:
    return "analysis.main", str(path), "--out", str(path.parent / "page.html")


IN_A_PROCESS = [
    "a chunk of 2^60 bytes", "a zstd bomb that says it is small", "an lz4 bomb",
    "profiles of aliases", "empty elements",
]  # fmt: skip


def test_hostile_bags_take_little_memory_and_time(tmp_path):
    calls = []
    for number, case in enumerate(IN_A_PROCESS):
        folder = hostile(tmp_path / f"{number}", BODIES[case][0]())
        calls += [analysing(folder), ("bags.recorder", "--recover", str(folder))]
    found = bounded(*calls)
    for number, case in enumerate(IN_A_PROCESS):
        (code, said), recovered = found[2 * number : 2 * number + 2]
        assert (code, recovered[0]) == (2, 0), case
        assert BODIES[case][1] in said, case
        assert Bag(tmp_path / f"{number}_recovered").warning == ""


# --- in this process -----------------------------------------------------------------------
def read_all(folder: Path) -> None:
    """Read a bag in every way; raises BagError or nothing."""
    bag = Bag(folder)
    assert bag.metadata["version"] == 9
    raw = list(bag.read_raw())
    decoding = [lambda name=name: list(bag.messages([name])) for name in bag.topics]
    decoding += [lambda one=one: bag.decode(one) for one in raw]
    for read in (*decoding, bag.parameters, bag.robot_description):
        with contextlib.suppress(BagError):
            read()


@pytest.mark.parametrize("case", [case for case in BODIES if case not in IN_A_PROCESS])
def test_a_hostile_bag_is_read_told_of_and_recovered(case, tmp_path):
    body, words = BODIES[case]
    folder = hostile(tmp_path / "bag", body())
    read_all(folder)
    assert words in Bag(folder).warning
    assert len(Bag(folder).warning) < 10 * LONGEST_LINE
    whole = recover(folder).bag
    read_all(whole)
    assert recover(whole).bag == whole
    with contextlib.redirect_stdout(io.StringIO()) as said:
        assert main([str(folder), "--no-page"]) == 2
    assert said.getvalue().startswith("error: ")


def a_run(folder: Path) -> Path:
    return write_run(folder, [0.01 * i for i in range(20)], [0.01 * i for i in range(20)])


@pytest.mark.parametrize(
    "make",
    [os.mkfifo, os.mkdir, lambda path: os.symlink("/dev/zero", path)],  # it is endless
)
def test_what_is_no_file_is_neither_waited_for_nor_read(make, tmp_path):
    folder = a_run(tmp_path / "run")
    (folder / "metadata.yaml").unlink()
    make(folder / "metadata.yaml")
    assert Bag(folder).metadata["message_count"] == 42
    (folder / "run_0.mcap").unlink()
    make(folder / "run_0.mcap")
    for read in (Bag, recover):
        with pytest.raises(BagError, match=r"run_0\.mcap is no file"):
            read(folder)


@pytest.mark.parametrize(
    "paths", [["../../etc/passwd"], ["/etc/passwd"], ["run_0.mcap", "../secret.mcap"], [3], "x", {}]
)
def test_the_files_that_metadata_yaml_names_are_not_followed(paths, tmp_path):
    folder = a_run(tmp_path / "run")
    secret = a_run(tmp_path / "other") / "other_0.mcap"
    secret.rename(tmp_path / "secret.mcap")
    before = (tmp_path / "secret.mcap").read_bytes()
    told = yaml.safe_load((folder / "metadata.yaml").read_text())
    information = told["rosbag2_bagfile_information"]
    information["relative_file_paths"] = paths
    information["files"] = [{"path": path} for path in paths] if isinstance(paths, list) else paths
    (folder / "metadata.yaml").write_text(yaml.safe_dump(told))
    assert len(list(Bag(folder).read_raw())) == 42
    result = recover(folder)
    assert result.messages == 42
    assert Bag(result.bag).metadata["relative_file_paths"] == ["run_0.mcap"]
    assert (tmp_path / "secret.mcap").read_bytes() == before
    there = ["other", "run", "run_recovered", "secret.mcap"]
    assert sorted(path.name for path in tmp_path.iterdir()) == there


@pytest.mark.parametrize(
    ("yaml_text", "words"),
    [
        (aliases(), "its aliases stand for more than"),
        (aliases(merged=True), "its aliases stand for more than"),
        ("&a [*a]", "a collection contains itself"),
        ("!!python/object/apply:os.system ['true']", "could not determine a constructor"),
        ("[" * 5000, "is not valid YAML"),
        ("x" * 4_000_001, "4000001 characters; expected at most"),
    ],
)
def test_yaml_of_a_bag_that_is_no_plain_data_is_refused(yaml_text, words):
    with pytest.raises(BagError, match=re.escape(words)) as refusal:
        load_yaml(yaml_text, "a bag")
    assert "\n" not in str(refusal.value)
    assert len(str(refusal.value)) < LONGEST_LINE


@pytest.mark.parametrize(
    ("definition", "words"),
    [
        ("a/A x", "contains itself"),
        ("a/B x", "a/msg/B is not defined"),
        ("int32 x\n" * 5001, "fields; expected at most 5000"),
        ("# " + "x" * 2**18, "bytes; expected at most 262144"),
        (
            "a/T0 x" + "".join(f"\n{'=' * 80}\nMSG: a/T{i}\na/T{i + 1} x" for i in range(60)),
            "more than 50 types within each other",
        ),
    ],
)
def test_a_schema_that_no_message_has_is_refused(definition, words):
    with pytest.raises(BagError, match=r"the schema of a/msg/A cannot be understood") as refusal:
        list(columns(Schema(1, definition.encode("latin-1"), "ros2msg", "a/msg/A"), [LONG]))
    assert words in str(refusal.value)


# --- damage of what is in a whole bag, up to the page --------------------------------------
Change = Callable[[str, bytes], bytes]
Build = Callable[..., bytes]


def unchanged(_topic: str, message: bytes) -> bytes:
    return message


@pytest.fixture(scope="module")
def build(tmp_path_factory: pytest.TempPathFactory) -> Build:
    """Makes the MCAP file of a run without checksums, each of its messages changed."""
    frames = [DesiredFrame(np.array([1.0, 0.0, 0.0]), np.eye(3))] * 25
    q = [0.01 * i for i in range(25)]
    folder = write_run(
        tmp_path_factory.mktemp("run") / "run",
        q,
        q,
        efforts=[1.0] * 25,
        parameters={"orientation": "euler_parameters"},
        wrenches=[[1.0] * 6] * 25,
        compliant=frames,
        began=5,
        lasting=0.1,
    )
    messages = list(Bag(folder).read_raw())

    def make(
        change: Change = unchanged,
        compression: Compression = Compression.NONE,
        definition: Callable[[str], str] = lambda topic: message_definition(_TYPES[topic]),
    ) -> bytes:
        stream = io.BytesIO()
        writer = Writer(stream, compression=compression, enable_crcs=False)
        writer.start("ros2")
        numbers = {}
        for name, kind in _TYPES.items():
            number = writer.register_schema(kind, "ros2msg", definition(name).encode())
            numbers[name] = writer.register_channel(name, "cdr", number)
        for one in messages:
            data = change(one.topic, one.data)
            writer.add_message(numbers[one.topic], one.log_time, data, one.publish_time)
        writer.add_attachment(0, 0, "parameters.yaml", "text/plain", b"{a: {b: 1}}")
        writer.finish()
        return stream.getvalue()

    return make


def analysed(data: bytes, folder: Path) -> int:
    """Return the exit code of ``analyze``; an exception of it would end the test."""
    (folder / "x.mcap").write_bytes(data)
    with contextlib.redirect_stdout(io.StringIO()) as said:
        code = main([str(folder / "x.mcap"), "--out", str(folder / "page.html")])
    assert code in (0, 2)
    assert code == 0 or "error: " in said.getvalue()
    return code


IMPOSSIBLE = [
    *(struct.pack("<d", value) for value in (float("nan"), float("inf"), 1e308, -1e308, 5e-324)),
    *(b"\xff\xff\xff\xff", b"\x00\x00\x00\x80", b"\xff\xff\xff\x7f", b"\x00\x00\x00\x00"),
]


@pytest.mark.filterwarnings("ignore::RuntimeWarning")  # of numbers near 1e308
@examples(25)
@given(data=st.data(), topic=st.sampled_from(sorted(_TYPES)), every=st.integers(1, 5))
def test_impossible_numbers_or_lengths_are_analysed_or_refused(data, topic, every, build, tmp_path):
    new, at = data.draw(st.sampled_from(IMPOSSIBLE)), data.draw(st.integers(1, 40))
    count = 0

    def change(name: str, message: bytes) -> bytes:
        nonlocal count
        count += name == topic
        if name != topic or count % every or 4 * at + len(new) > len(message):
            return message
        return message[: 4 * at] + new + message[4 * at + len(new) :]

    analysed(build(change), tmp_path)


@pytest.mark.filterwarnings("ignore::RuntimeWarning")
@examples(100)
@given(data=st.data(), flips=st.integers(1, 5), compression=st.sampled_from(Compression))
def test_a_bag_with_damaged_bytes_is_read_recovered_and_analysed_or_refused(
    data, flips, compression, build, tmp_path
):
    damaged = bytearray(build(compression=compression))
    for _ in range(flips):
        damaged[data.draw(st.integers(0, len(damaged) - 1))] ^= data.draw(st.integers(1, 255))
    analysed(bytes(damaged), tmp_path)
    for act in (read_all, recover, read_all):
        with contextlib.suppress(BagError):
            act(tmp_path)


DAMAGE = {
    "name": lambda text: re.sub(r"^([^#\s]+)\s+(\w+)\b", r"\1 \2x", text, count=1, flags=re.M),
    "type": lambda text: re.sub(r"^([^#\s]+)\s+(\w+)\b", r"\1[] \2", text, count=1, flags=re.M),
    "unknown type": lambda text: f"{text}\na/B x\n",
    "nothing": lambda text: "",
}


@pytest.mark.parametrize("damage", DAMAGE)
@pytest.mark.parametrize("topic", sorted(_TYPES.keys() - {"/target_wrench"}))  # it is not read
def test_a_topic_whose_schema_is_not_that_of_its_type_is_left_out(topic, damage, build, tmp_path):
    def definition(name: str) -> str:
        text = message_definition(_TYPES[name])
        return DAMAGE[damage](text) if name == topic else text

    code = analysed(build(definition=definition), tmp_path)
    is_needed = topic in ("/joint_states", "/robot_description", "/reference")  # its tip frame
    assert code == (2 if is_needed else 0)
    if not code:
        flaws = load(tmp_path / "x.mcap").warnings
        assert [f.kind for f in flaws if topic in f.text] == [BagFlaw.LEFT_OUT]
        return
    with pytest.raises(BagError, match=topic):
        load(tmp_path / "x.mcap")
    if topic != "/joint_states":
        assert len(load(tmp_path / "x.mcap", URDF, "tip", base_frame="base").measured.t) == 25


def test_definitions_that_differ_by_their_comments_are_of_one_type(build, tmp_path):
    data = build(definition=lambda name: f"# of {name}\n{message_definition(_TYPES[name])}")
    for name, content in (("a", data), ("b", build())):
        (tmp_path / f"{name}.mcap").write_bytes(content)
    assert Bag(tmp_path).schema("/wrench").name == _TYPES["/wrench"]
    assert not any(flaw.kind is BagFlaw.LEFT_OUT for flaw in load(tmp_path).warnings)
